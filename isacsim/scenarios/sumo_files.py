"""SUMO's networks, routes and additional files: what they hold, and how they are handed to SUMO without danger.

Input files may come from anyone, and many elements make SUMO write a file. SUMO gets what its own schemas name, and of
that nothing that names an output. A file that holds anything else is handed over as a temporary copy without it.
"""

from __future__ import annotations

import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import TextIO
from xml.sax.saxutils import quoteattr

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.base.temporary import TemporaryFolder
from isac_cosim.isacsim.scenarios import sumo_schemas
from isac_cosim.isacsim.scenarios.sumo_schemas import TRUE
from isac_cosim.isacsim.scenarios.xml_files import Element, XmlReader, elements

CONFIG_ENDINGS = (".sumocfg", ".sumo.cfg")
NETWORK_ENDINGS = (".net.xml", ".net.xml.gz")

ONLY_WRITE = ("edgeData", "laneData", "vTypeProbe", "timedEvent")
"""Elements that do nothing else than make SUMO write a file. Traffic lights and calibrators may need the others."""
OUTPUT_ATTRIBUTES = frozenset({"file", "output", "dest", "outputFile"})
"""Attributes that name a file that SUMO writes, save for those below."""
INPUT_ATTRIBUTES = {"include": "href", "variableSpeedSign": "file", "calibrator": "file"}
"""Attributes that name a file that SUMO reads, by their elements; its place is relative to the file that names it."""
OUTPUT_DEVICES = ("has.ssm.device", "has.toc.device")
"""Parameters that equip a vehicle with a device that writes a file."""
OUTPUT_PARAMETER = re.compile(r"(?:.*\.)?(?:files?|outputs?)", re.DOTALL)
"""Parameters that name a file."""
NOWHERE, ALSO_NOWHERE = "NUL", ("NUL", "/DEV/NULL")
"""File names with which SUMO writes nothing: the first on every system, and in capitals."""
DEMAND = frozenset({"vehicle", "flow", "trip"})
TYPES = frozenset({"vType", "vTypeDistribution"})
Rewrite = Callable[[Iterable[Element]], Iterator[Element]]
"""Changes the elements of a file that SUMO gets."""
SCHEMA_ATTRIBUTES = frozenset({"xmlns:xsi", "xsi:noNamespaceSchemaLocation", "xsi:schemaLocation"})
"""Attributes of root elements that name a schema. SUMO is told not to look for it."""
UNREAD = ("metadata",)
"""Elements of SUMO's own writing that it does not read."""
MOST_INCLUDED, DEEPEST_INCLUDE = 10_000, 100
"""How many files SUMO may be made to read for one, each as often as it is included, and within each other."""
MOST_REMOVED = 1000
"""Kinds of things left out of a file that are told apart."""
MISREAD = re.compile(r"^\s|\s$|,|\$\{|(?<!^[A-Za-z]):|[^\x00-\x7f]")
"""What SUMO reads differently in an option than in the name of a file, or by the environment's variables or language:
spaces at the ends, commas, `${`, colons other than a drive's, and letters that are not ASCII."""


@dataclass(frozen=True)
class Content:
    """What a file holds.

    names: of its elements. inputs: paths of the files that it makes SUMO read, in order, as often as it does. removed:
    what SUMO does not get of it, with the number of occurrences. as_it_is: whether SUMO may get the file itself.
    """

    names: frozenset[str]
    inputs: tuple[Path, ...]
    removed: tuple[tuple[str, int], ...]
    as_it_is: bool


def content(file: Path) -> Content:
    """Return what a file holds. It is read once, as long as it does not change.

    Raises InputError where it cannot be read, or makes SUMO read a file that does not exist.
    """
    try:
        state = file.stat()
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): fix that") from None
    held = _content(file, state.st_ino, state.st_size, state.st_mtime_ns)
    for path in held.inputs:
        if not path.is_file():
            name = os.path.relpath(path, file.parent)
            raise InputError(f"{file} includes {name!r}, which does not exist: add the file or remove the element")
    return held


@lru_cache(maxsize=256)
def _content(file: Path, *_: int) -> Content:
    names: set[str] = set()
    inputs: list[Path] = []
    removed: Counter[str] = Counter()
    reader, rewritten, unread = XmlReader(file), False, Counter[str]()

    def begun() -> Iterator[Element]:
        for element in reader.elements():
            # SUMO does not read them, but it reads what lies within them.
            unread[element.name] += element.name in UNREAD
            yield element

    for element, passed in _filtered(begun(), removed):
        names.add(passed.name)
        rewritten |= passed is not element
        reads = INPUT_ATTRIBUTES.get(passed.name)
        if reads and (name := passed.attributes.get(reads)):
            inputs.append(file.parent / name)  # SUMO expands nothing in it
            # SUMO takes a name with a colon or a backslash for an absolute one.
            rewritten |= MISREAD.search(name) is not None or "\\" in name
    as_it_is = reader.plain and not rewritten and not removed and not unread.total()
    return Content(frozenset(names), tuple(inputs), tuple(sorted(removed.items())), as_it_is)


@cache
def _harmless() -> Mapping[str, frozenset[str]]:
    """The elements that neither write nor read files nor set parameters, with their attributes."""
    special = {*ONLY_WRITE, *INPUT_ATTRIBUTES, *UNREAD, "param"}
    known = sumo_schemas.known_elements().items()
    return {name: attributes - OUTPUT_ATTRIBUTES for name, attributes in known if name not in special}


def _filtered(begun: Iterable[Element], removed: Counter[str]) -> Iterator[tuple[Element, Element]]:
    """Yield the elements of a file that SUMO gets, each as it stands and as SUMO gets it.

    Both are the same object where nothing is changed. removed: counts what is left out.
    """
    harmless, roots, none = _harmless(), sumo_schemas.root_names(), frozenset[str]()
    left_out: int | None = None  # the depth of an element that is left out with everything inside
    for element in begun:
        depth, name, attributes = element
        if left_out is not None and depth > left_out:
            continue
        left_out = None
        if attributes.keys() <= harmless.get(name, none) and name in harmless:
            yield element, element
        elif depth == 0 and (name in roots or name not in sumo_schemas.known_elements()):
            yield element, _root(element)
        elif (passed := _passed(element, removed)) is not None:
            yield element, passed
        else:
            left_out = depth


def _root(element: Element) -> Element:
    """A root that only holds the others, as SUMO gets it."""
    allowed = sumo_schemas.known_elements().get(element.name)
    if allowed is None:
        return Element(0, "additional", {})
    if element.attributes.keys() <= allowed | SCHEMA_ATTRIBUTES:
        return element
    return Element(0, element.name, {name: text for name, text in element.attributes.items() if name in allowed})


def _passed(element: Element, removed: Counter[str]) -> Element | None:
    """Return an element as SUMO gets it, None where it gets nothing of it."""
    depth, name, attributes = element
    known = sumo_schemas.known_elements().get(name)
    if known is None or name in ONLY_WRITE:
        _note(removed, name)
        return None
    if name in UNREAD:
        return None
    if name == "param" and _writes(attributes):
        _note(removed, f"param {attributes['key']}")
        return None
    passed = {}
    for attribute, text in attributes.items():
        if attribute not in known:
            if attribute != "xmlns":
                _note(removed, f"{name} {attribute}")
        elif (
            attribute in OUTPUT_ATTRIBUTES
            and attribute != INPUT_ATTRIBUTES.get(name)
            and text.upper() not in ALSO_NOWHERE
        ):
            _note(removed, f"{name} {attribute}")
            passed[attribute] = NOWHERE
        else:
            passed[attribute] = text
    return element if passed == attributes else Element(depth, name, passed)


def _note(removed: Counter[str], what: str) -> None:
    """Count something that is left out, under a name that can be shown."""
    what = "".join(letter if letter.isprintable() else "?" for letter in what[:60])
    removed[what if what in removed or len(removed) < MOST_REMOVED else "others"] += 1


def _writes(parameter: dict[str, str]) -> bool:
    """Whether a parameter, by its key and value, makes SUMO write a file."""
    key = parameter.get("key", "").strip()
    if key in OUTPUT_DEVICES:
        return parameter.get("value", "").strip().lower() in TRUE
    return OUTPUT_PARAMETER.fullmatch(key) is not None


def has_demand(file: Path) -> bool:
    """Whether a file, or one that it includes, puts vehicles on the road."""
    return any(content(path).names & DEMAND for path in with_includes(file))


def with_includes(file: Path) -> list[Path]:
    """Return a file and the files that it includes or reads otherwise, and those that they do, each once.

    Raises InputError where one of them does not exist or cannot be read, or where they include each other.
    """
    files, known = [file], {file.resolve()}
    for path in files:  # grows while it is read
        for named in content(path).inputs:
            if named.resolve() not in known:
                known.add(named.resolve())
                files.append(named)
        if len(files) > MOST_INCLUDED:
            raise InputError(f"{file} includes more than {MOST_INCLUDED} files: join them")
    _count(file, {}, 0)
    return files


def _count(file: Path, counts: dict[Path, int], depth: int) -> int:
    """Return how many files SUMO reads for one. counts: of those already counted, 0 while they are."""
    place = file.resolve()
    if counts.get(place) == 0 or depth > DEEPEST_INCLUDE:
        fault = "includes itself" if place in counts else f"is included at depth {depth}"
        raise InputError(f"{file} {fault}: remove the element")
    if place not in counts:
        counts[place] = 0
        counts[place] = 1 + sum(_count(named, counts, depth + 1) for named in content(file).inputs)
    if counts[place] > MOST_INCLUDED:
        raise InputError(f"{file} makes SUMO read more than {MOST_INCLUDED} files: include each once")
    return counts[place]


def removed_from(files: Iterable[Path]) -> tuple[str, ...]:
    """Return what SUMO does not get of files and of those that they include: what, how often, and of which file."""
    parts = dict.fromkeys(part.resolve() for file in files for part in with_includes(file))
    return tuple(
        f"{what}{f' ({number} times)' if number > 1 else ''} in {part.name}"
        for part in parts
        for what, number in content(part).removed
    )


@contextmanager
def cleaned(file: Path) -> Iterator[Path]:
    """Yield the path of a file that any reader of XML reads as SUMO does: its own, or that of a temporary copy."""
    if content(file).as_it_is:
        yield file
    else:
        with TemporaryFolder(landlock.folder()) as temporary:
            yield Handover(temporary.path).path_of(file)


@dataclass(frozen=True)
class Handover:
    """Hands files to SUMO: those that are safe themselves, and of the others copies or links in a temporary folder.

    types: changes the elements of files with vehicle types.
    """

    folder: Path
    types: Rewrite | None = None
    _done: dict[Path, Path] = field(default_factory=dict)

    def path_of(self, file: Path) -> Path:
        """Return the path by which SUMO gets a file.

        Raises InputError as `with_includes` does, and where SUMO would misread the path of the temporary folder.
        """
        clean = not any(map(self._changes, with_includes(file)))
        if clean and not MISREAD.search(str(file)):
            return file
        place = file.resolve()
        if place not in self._done:
            if re.search(r",|\$\{", str(self.folder)):
                raise InputError(f"SUMO misreads the path {self.folder}: set TMPDIR to a folder without , and $ in it")
            name = re.sub(r"[^\w.-]", "_", file.name.removesuffix(".gz"), flags=re.ASCII)
            self._done[place] = self.folder / f"{len(self._done)}-{name}"
            if clean and not content(file).inputs:
                _alias(self._done[place], place)
            else:
                with self._done[place].open("x", encoding="utf-8", newline="\n") as copy:
                    self._write(copy, file)
        return self._done[place]

    def _changes(self, file: Path) -> bool:
        """Whether SUMO gets a file, but not those that it includes, otherwise than it is."""
        held = content(file)
        return not held.as_it_is or (self.types is not None and bool(held.names & TYPES))

    def _write(self, copy: TextIO, file: Path) -> None:
        """Write what SUMO gets of a file. Every file that it names is named by its absolute path."""
        copy.write('<?xml version="1.0" encoding="UTF-8"?>\n')
        begun: list[str] = []
        empty = False  # whether the last element may yet turn out to be empty
        passed: Iterable[Element] = (after for _, after in _filtered(elements(file), Counter()))
        for depth, name, attributes in passed if self.types is None else self.types(passed):
            empty = _end(copy, begun, depth, empty)
            copy.write(">\n" if empty else "")
            copy.write(f"<{name}")
            for attribute, text in attributes.items():
                if attribute in SCHEMA_ATTRIBUTES:
                    continue
                if text and attribute == INPUT_ATTRIBUTES.get(name):
                    text = os.path.abspath(self.path_of(file.parent / text))
                copy.write(f" {attribute}={quoteattr(text)}")
            begun.append(name)
            empty = True
        _end(copy, begun, 0, empty)


def _end(copy: TextIO, begun: list[str], depth: int, empty: bool) -> bool:
    """End the elements that were begun at a depth or below. empty: whether the last one is. Returns that afterwards."""
    while len(begun) > depth:
        name = begun.pop()
        copy.write("/>\n" if empty else f"</{name}>\n")
        empty = False
    return empty


def option_path(file: Path, folder: Path) -> Path:
    """Return a path by which an option of SUMO's programs can name a file: its own, or a link's in a folder."""
    if not MISREAD.search(str(file)):
        return file
    place = folder / f"{len(list(folder.iterdir()))}{file.suffix}"
    _alias(place, file.resolve())
    return place


def _alias(place: Path, file: Path) -> None:
    """Make a link to a file; where the system does not let us, a copy."""
    try:
        place.symlink_to(file)
    except OSError:  # Windows asks for a privilege
        shutil.copyfile(file, place)


def is_lefthand(network: Path) -> bool:
    """Return whether a network is built for left-hand traffic, which its root element says. Only that is read.

    Raises InputError where the file cannot be read.
    """
    root = next(elements(network), None)
    return root is not None and root.attributes.get("lefthand", "").strip().lower() in TRUE
