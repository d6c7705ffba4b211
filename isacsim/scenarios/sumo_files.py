"""What SUMO's own input files say: configurations, and additional files made safe to load.

They may come from others: a file with a document type is refused, so that no entity is expanded and no other file read,
and what would make SUMO write files is taken out or refused.
"""

from __future__ import annotations

import gzip
import os
import re
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import defusedxml.ElementTree
from defusedxml import DTDForbidden

from isacsim.errors import InputError

CONFIG_ENDINGS = (".sumocfg", ".sumo.cfg")
NETWORK_ENDINGS = (".net.xml", ".net.xml.gz")

SYNONYMS = {
    "net": "net-file", "n": "net-file", "routes": "route-files", "r": "route-files",
    "additional": "additional-files", "a": "additional-files", "b": "begin",
}  # fmt: skip
KEPT = (
    "scale",
    "ignore-route-errors",
    "no-internal-links",
    "ignore-junction-blocker",
    "max-depart-delay",
    "extrapolate-departpos",
    "pedestrian.model",
    "device.rerouting.probability",
    "device.rerouting.period",
    "device.rerouting.adaptation-interval",
    "device.rerouting.adaptation-steps",
    "tls.actuated.jam-threshold",
    "eager-insert",
    "random-depart-offset",
    "emergencydecel.warning-threshold",
    "collision.mingap-factor",
)
"""Options of a user's configuration that shape the traffic and not the tool's time base, outputs or windows."""
XML_FAULTS = (ET.ParseError, EOFError, LookupError, OSError, ValueError, zlib.error)
"""What the readers of XML and gzip raise on files that are neither."""
OUTPUT_ATTRIBUTES = ("file", "output", "dest", "outputFile")
OUTPUT_ELEMENTS = (
    "e1Detector", "inductionLoop", "instantInductionLoop", "e2Detector", "laneAreaDetector", "e3Detector",
    "entryExitDetector", "edgeData", "laneData", "edgedata", "lanedata", "meandata-edge", "meandata-lane",
    "routeProbe", "vTypeProbe", "timedEvent", "calibrator",
)  # fmt: skip
OUTPUT_PARAMS = ("has.ssm.device", "has.toc.device", "file")
"""Parameters, of vehicles and of traffic lights, by which SUMO writes a file."""
NO_OUTPUT = ("", "0", "false", "no", "off", "f", "-", "nul", "null")
MAY_WRITE = re.compile(rb"(ssm|toc)\.device|[\"']file[\"']|\s(file|output|dest|outputFile)\s*=|&#|\x00")
"""What a file that makes SUMO write another holds somewhere; character references and wide encodings may hide it."""
STEMS = (b"ssm", b"toc", b"file", b"output", b"dest", b"&#", b"\x00")
"""One of them is in whatever MAY_WRITE matches; they are looked for first, because that is ten times as fast."""
BLOCK, OVERLAP = 1 << 20, 64
"""Bytes read at once, and of those before them that are looked at again."""


@dataclass(frozen=True)
class Inputs:
    """What a configuration is taken to say.

    begin_s: simulation time at which it starts, s. kept: its options that SUMO gets, by name.
    overridden: its options that the tool sets itself or leaves out.
    """

    network: Path
    demand: tuple[Path, ...]
    additional: tuple[Path, ...]
    begin_s: float
    kept: dict[str, str]
    overridden: tuple[str, ...]


def read_config(config: Path) -> Inputs:
    """Read a SUMO configuration. Raises InputError, by name, for what it names and is not there."""
    options = {SYNONYMS.get(node.tag, node.tag): node.get("value", node.get("v", "")) for node in parse(config).iter()}
    options = {name: value for name, value in options.items() if value}

    def files(option: str) -> tuple[Path, ...]:
        names = [name.strip() for name in options.pop(option, "").split(",")]
        found = tuple(config.parent / os.path.expandvars(name) for name in names if name)
        for file in found:
            if not file.is_file():
                raise InputError(f"{config} names {file.name}, which is not there: add it or take its name out")
        return found

    networks, demand, additional = files("net-file"), files("route-files"), files("additional-files")
    if len(networks) != 1:
        raise InputError(f"{config} names {len(networks)} networks: give it one <net-file value=…/>")
    begin = options.pop("begin", "0")
    try:
        begin_s = float(begin)
    except ValueError:
        raise InputError(f"{config}: begin = {begin!r} is no number of seconds: write it so") from None
    kept = {name: options.pop(name) for name in KEPT if name in options}
    return Inputs(networks[0], demand, additional, begin_s, kept, tuple(sorted(options)))


def has_demand(file: Path) -> bool:
    """Whether a file puts vehicles on the road; it is read no further than the first."""
    with _reading(file) as stream:
        return any(node.tag in ("vehicle", "flow", "trip") for node in _elements(stream))


def without_outputs(file: Path, folder: Path) -> Path:
    """An additional file without what would make SUMO write beside it: itself, or a copy in a folder."""
    root = parse(file)
    taken = 0
    for parent in list(root.iter()):
        for child in list(parent):
            if _makes_output(child):
                if child.tag == "calibrator":  # it shapes the traffic too
                    child.attrib.pop("output", None)
                else:
                    parent.remove(child)
                taken += 1
    if not taken:
        return file
    copy = folder / f"{len(list(folder.iterdir()))}-{file.name.removesuffix('.gz')}"
    ET.ElementTree(root).write(copy, encoding="utf-8")
    return copy


def refuse_outputs(file: Path) -> None:
    """Raises InputError where a network or route file would make SUMO write a file."""
    with _reading(file) as stream:
        if not _may_write(stream):
            return
        stream.seek(0)
        for node in _elements(stream):
            if _makes_output(node):
                name = node.get("key", node.get("id", ""))
                raise InputError(f"{file}: {node.tag} {name!r} makes SUMO write a file of its own: take it out")


def _may_write(stream: IO[bytes]) -> bool:
    """Whether a file has to be read as XML to know that it makes SUMO write nothing."""
    before = b""
    while block := stream.read(BLOCK):
        text = before + block
        if any(stem in text for stem in STEMS) and MAY_WRITE.search(text):
            return True
        before = block[-OVERLAP:]
    return False


def _makes_output(node: ET.Element) -> bool:
    """Whether an element, as it begins, asks SUMO for a file."""
    if node.tag == "param":
        return node.get("key") in OUTPUT_PARAMS and node.get("value", "").strip().lower() not in NO_OUTPUT
    return node.tag in OUTPUT_ELEMENTS and any(node.get(name) for name in OUTPUT_ATTRIBUTES)


def parse(file: Path) -> ET.Element:
    """The root of an XML file. Raises InputError in one line."""
    with _reading(file) as stream:
        root: ET.Element = defusedxml.ElementTree.parse(stream, forbid_dtd=True).getroot()
        return root


def refuse_document_type(file: Path) -> None:
    """Look at an XML file, before others read it, as far as its first element. Raises InputError."""
    with _reading(file) as stream:
        next(_elements(stream), None)


def _elements(stream: IO[bytes]) -> Iterator[ET.Element]:
    """The elements of an XML file as they begin."""
    return (node for _, node in defusedxml.ElementTree.iterparse(stream, ("start",), forbid_dtd=True))


@contextmanager
def _reading(file: Path) -> Iterator[IO[bytes]]:
    """An XML file, which may be gzipped, open for reading. What fails becomes an InputError in one line."""
    try:
        with cast(IO[bytes], gzip.open(file)) if file.name.endswith(".gz") else file.open("rb") as stream:
            yield stream
    except DTDForbidden:
        raise InputError(
            f"{file} declares a document type (DTD), by which a file pulls in others or grows without end: take it out"
        ) from None
    except XML_FAULTS as error:
        raise InputError(f"{file} cannot be read as XML: {one_line(error)}") from None


def one_line(error: object) -> str:
    """An error's text without line breaks."""
    return " ".join(str(error).split()) or type(error).__name__
