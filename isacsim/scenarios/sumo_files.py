"""Reading SUMO's input files: configurations, and additional files made safe to load.

Input files may come from anyone. A file with a document type is refused, so that no entity is expanded. Files that a
file includes are read as SUMO reads them. Whatever would make SUMO write a file is removed or refused.
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

from isac_cosim.base.errors import InputError

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
    "default.carfollowmodel",
    "default.departlane",
    "default.departspeed",
    "default.emergencydecel",
    "default.speeddev",
    "device.rerouting.probability",
    "device.rerouting.explicit",
    "device.rerouting.deterministic",
    "device.rerouting.period",
    "device.rerouting.pre-period",
    "device.rerouting.adaptation-interval",
    "device.rerouting.adaptation-steps",
    "device.rerouting.adaptation-weight",
    "lanechange.overtake-right",
    "max-num-vehicles",
    "routing-algorithm",
    "time-to-impatience",
    "tls.actuated.detector-length",
    "tls.actuated.jam-threshold",
    "tls.yellow.min-decel",
    "weights.minor-penalty",
    "weights.priority-factor",
    "weights.random-factor",
    "weights.tls-penalty",
    "eager-insert",
    "emergency-insert",
    "sloppy-insert",
    "random-depart-offset",
    "emergencydecel.warning-threshold",
    "collision.mingap-factor",
)
"""Options of a user's configuration that shape the traffic, and are passed to SUMO."""
XML_FAULTS = (ET.ParseError, EOFError, LookupError, OSError, ValueError, zlib.error)
"""What the readers of XML and gzip raise on other files."""
OUTPUT_ATTRIBUTES = ("file", "output", "dest", "outputFile")
PURE_OUTPUTS = (
    "edgeData", "laneData", "edgedata", "lanedata", "meandata-edge", "meandata-lane", "vTypeProbe", "timedEvent",
)  # fmt: skip
"""Elements that do nothing else than make SUMO write a file."""
OUTPUT_ELEMENTS = (
    *PURE_OUTPUTS, "e1Detector", "inductionLoop", "instantInductionLoop", "e2Detector", "laneAreaDetector",
    "e3Detector", "entryExitDetector", "routeProbe", "calibrator",
)  # fmt: skip
"""Elements that make SUMO write a file. Traffic lights and calibrators may need the others for what they measure."""
NOWHERE = "NUL"
"""A file name with which SUMO writes nothing, on every system."""
INPUT_ATTRIBUTES = ("file", "href", "imgFile")
"""Attributes that may name a file that SUMO reads; its place is relative to the file that names it."""
INCLUDE = "include"
OUTPUT_PARAMS = ("has.ssm.device", "has.toc.device", "file")
"""Parameters of vehicles and traffic lights that make SUMO write a file."""
TRUE = ("1", "true", "yes", "on", "x", "t")
"""What SUMO reads as true."""
NO_OUTPUT = ("", "0", "false", "no", "off", "f", "-", "nul", "null")
MAY_WRITE = re.compile(rb"(ssm|toc)\.device|[\"']file[\"']|\s(file|output|dest|outputFile)\s*=|&#|\x00")
"""Found in every file that makes SUMO write another. Character references and wide encodings may hide the words."""
MAY_INCLUDE = re.compile(rb"<\s*include|\x00")
"""Found in every file that includes another."""
STEMS = (b"ssm", b"toc", b"file", b"output", b"dest", b"&#", b"\x00")
"""Each match of MAY_WRITE contains one of them. They are searched first, because that is ten times as fast."""
BLOCK, OVERLAP = 1 << 20, 64
"""Bytes read at once, and how many of the bytes before are searched again with them."""


@dataclass(frozen=True)
class Inputs:
    """What is read from a configuration.

    begin_s: simulation time at which the scenario starts, s. kept: options that are passed to SUMO, by name.
    overridden: names of options that are set otherwise or left out.
    """

    network: Path
    demand: tuple[Path, ...]
    additional: tuple[Path, ...]
    begin_s: float
    kept: dict[str, str]
    overridden: tuple[str, ...]


def read_config(config: Path) -> Inputs:
    """Read a SUMO configuration. Raises InputError where it names no network, or a file that does not exist."""
    options = {SYNONYMS.get(node.tag, node.tag): node.get("value", node.get("v", "")) for node in parse(config).iter()}
    options = {name: value for name, value in options.items() if value}

    def files(option: str) -> tuple[Path, ...]:
        names = [name.strip() for name in options.pop(option, "").split(",")]
        paths = tuple(config.parent / os.path.expandvars(name) for name in names if name)
        for path in paths:
            if not path.is_file():
                raise InputError(f"{config} names {path.name}, which does not exist: add the file or remove its name")
        return paths

    networks, demand, additional = files("net-file"), files("route-files"), files("additional-files")
    if len(networks) != 1:
        raise InputError(f"{config} names {len(networks)} networks: give it exactly one <net-file value=…/>")
    begin = options.pop("begin", "0")
    try:
        begin_s = float(begin)
    except ValueError:
        raise InputError(f"{config}: begin = {begin!r} is not a number: give it in seconds") from None
    kept = {name: options.pop(name) for name in KEPT if name in options}
    return Inputs(networks[0], demand, additional, begin_s, kept, tuple(sorted(options)))


def has_demand(file: Path) -> bool:
    """Whether a file, or one that it includes, puts vehicles on the road. It is read up to the first one."""
    for path in with_includes(file):
        with _reading(path) as stream:
            if any(node.tag in ("vehicle", "flow", "trip") for node in _elements(stream)):
                return True
    return False


def with_includes(file: Path) -> list[Path]:
    """Return a file and the files that it includes, and those that they include, each once.

    Raises InputError where one of them does not exist or cannot be read.
    """
    files = [file]
    for path in files:  # grows while it is read
        with _reading(path) as stream:
            if not _holds(stream, (INCLUDE.encode(), b"\x00"), MAY_INCLUDE):
                continue
            stream.seek(0)
            names = [node.get("href", "") for node in _elements(stream) if node.tag == INCLUDE]
        for name in names:
            included = path.parent / os.path.expandvars(name)
            if not included.is_file():
                raise InputError(f"{path} includes {name!r}, which does not exist: add the file or remove the element")
            if included.resolve() not in [known.resolve() for known in files]:
                files.append(included)
    return files


def without_outputs(file: Path, folder: Path) -> Path:
    """Return the path of an additional file with which SUMO writes no file.

    That is the file itself where SUMO writes none, and a copy in the folder otherwise, with what it includes.
    """
    files = with_includes(file)
    roots = [parse(path) for path in files]
    if not any(_makes_output(node) for root in roots for node in root.iter()):
        return file
    first = len(list(folder.iterdir()))
    copies = {path.resolve(): folder / f"{first + k}-{path.name.removesuffix('.gz')}" for k, path in enumerate(files)}
    for path, root in zip(files, roots, strict=True):
        _silence(root)
        for node in root.iter():
            for name in INPUT_ATTRIBUTES:
                read = (path.parent / os.path.expandvars(node.get(name, ""))).resolve()
                if read.is_file():
                    node.set(name, str(copies.get(read, read)))
        ET.ElementTree(root).write(copies[path.resolve()], encoding="utf-8")
    return copies[file.resolve()]


def _silence(root: ET.Element) -> None:
    """Remove the elements and parameters that do nothing but write a file; the others write nowhere."""
    for parent in list(root.iter()):
        for child in list(parent):
            if not _makes_output(child):
                continue
            if child.tag == "param" or child.tag in PURE_OUTPUTS:
                parent.remove(child)
            for name in OUTPUT_ATTRIBUTES:
                if name in child.attrib:
                    child.set(name, NOWHERE)


def refuse_outputs(file: Path) -> None:
    """Raise InputError where a network or route file, or one that it includes, would make SUMO write a file."""
    for path in with_includes(file):
        with _reading(path) as stream:
            if not _holds(stream, STEMS, MAY_WRITE):
                continue
            stream.seek(0)
            for node in _elements(stream):
                if _makes_output(node):
                    name = node.get("key", node.get("id", ""))
                    raise InputError(f"{path}: {node.tag} {name!r} makes SUMO write a file: remove it")


def _holds(stream: IO[bytes], stems: tuple[bytes, ...], pattern: re.Pattern[bytes]) -> bool:
    """Whether a file has to be read as XML, because a pattern is in it. Each match contains one of the stems."""
    before = b""
    while block := stream.read(BLOCK):
        text = before + block
        if any(stem in text for stem in stems) and pattern.search(text):
            return True
        before = block[-OVERLAP:]
    return False


def _makes_output(node: ET.Element) -> bool:
    """Whether an element, by its own attributes, makes SUMO write a file."""
    if node.tag == "param":
        return node.get("key") in OUTPUT_PARAMS and node.get("value", "").strip().lower() not in NO_OUTPUT
    return node.tag in OUTPUT_ELEMENTS and any(
        node.get(name, "").strip().lower() not in NO_OUTPUT for name in OUTPUT_ATTRIBUTES
    )


def parse(file: Path) -> ET.Element:
    """Return the root of an XML file. Raises InputError where it cannot be read."""
    with _reading(file) as stream:
        root: ET.Element = defusedxml.ElementTree.parse(stream, forbid_dtd=True).getroot()
        return root


def refuse_document_type(file: Path) -> None:
    """Raise InputError where an XML file declares a document type. It is read up to the first element."""
    with _reading(file) as stream:
        next(_elements(stream), None)


def is_lefthand(network: Path) -> bool:
    """Return whether a network is built for left-hand traffic, which its root element says. Only that is read.

    Raises InputError where the file cannot be read.
    """
    with _reading(network) as stream:
        root = next(_elements(stream), None)
        return root is not None and root.get("lefthand", "").strip().lower() in TRUE


def _elements(stream: IO[bytes]) -> Iterator[ET.Element]:
    """The elements of an XML file, each as soon as it begins."""
    return (node for _, node in defusedxml.ElementTree.iterparse(stream, ("start",), forbid_dtd=True))


@contextmanager
def _reading(file: Path) -> Iterator[IO[bytes]]:
    """An XML file, possibly gzipped, open for reading. Errors of reading it become an InputError."""
    try:
        with cast(IO[bytes], gzip.open(file)) if file.name.endswith(".gz") else file.open("rb") as stream:
            yield stream
    except DTDForbidden:
        raise InputError(
            f"{file} declares a document type (DTD), which can read other files or expand without end: remove the DTD"
        ) from None
    except XML_FAULTS as error:
        raise InputError(f"{file} cannot be read as XML ({one_line(error)}): fix the file") from None


def write_lines(file: Path, text: str) -> None:
    """Write a text file with the same bytes on every system: UTF-8, and line feeds alone."""
    file.write_text(text, encoding="utf-8", newline="\n")


def one_line(error: object) -> str:
    """Return an error's text without line breaks."""
    return " ".join(str(error).split()) or type(error).__name__
