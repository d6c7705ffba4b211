"""What a file of vehicles and flows holds, and a copy of it in the order in which SUMO wants them.

SUMO reads a route file while it simulates, and leaves out a vehicle or flow that departs before one above it. Whoever
wrote such a file meant all of them to drive, so SUMO is given a copy with the same elements, sorted.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import IO, cast
from xml.parsers import expat

from isacsim.scenarios.sumo_files import with_includes
from isacsim.scenarios.sumo_values import seconds

VEHICLES = ("vehicle", "trip", "flow")
DEPARTS = ("vehicle", "trip", "person", "container")
"""Elements that depart at their attribute `depart`."""
BEGINS = ("flow", "personFlow", "containerFlow")
"""Elements that depart from their attribute `begin` on, by default from that of the simulation."""
DEFINITIONS = ("vType", "vTypeDistribution", "route", "routeDistribution")
"""Elements that others refer to, and that depart at no time."""
STANDING_ALONE = (*DEPARTS, *BEGINS, *DEFINITIONS)
DEFAULT_TYPE = "DEFAULT_VEHTYPE"
"""The type of a vehicle that names none."""
SUBLANE_MODELS = ("SL2015", "default")
"""The lane-change models that SUMO's sublane simulation takes."""
GZIP = b"\x1f\x8b"
"""The first bytes of a gzipped file."""
NEVER = float("-inf")


@dataclass(frozen=True)
class Element:
    """An element below the root of a file.

    start: where its text starts, bytes. depart_s: when it departs, s; None for at no known time.
    """

    start: int
    name: str
    id: str
    depart_s: float | None


@dataclass(frozen=True)
class DemandFile:
    """What is read of a file of vehicles and flows, without the files that it includes.

    departures: number of elements that depart. late: ids of those that SUMO leaves out, because they depart before one
    above them. sortable: whether every element stands for itself, so that only their order would change. first_s: when
    the first vehicle or flow of vehicles departs, s. models: lane-change model of each type that names one. used: types
    that vehicles and flows name. members: types in each distribution.
    """

    departures: int = 0
    late: tuple[str, ...] = ()
    sortable: bool = False
    first_s: float | None = None
    models: Mapping[str, str] = field(default_factory=dict)
    used: Collection[str] = ()
    members: Mapping[str, Collection[str]] = field(default_factory=dict)


def in_order(file: Path, folder: Path, begin_s: float) -> Path:
    """Return the path of a route file that is sorted by departure: the file itself, or a sorted copy in the folder.

    begin_s: of the simulation. A file whose elements do not stand for themselves (it includes others, or has
    intervals) is returned as it is.
    """
    if not is_put_in_order(read_demand(file, begin_s)):
        return file
    elements: list[Element] = []
    reader = _Reader(begin_s, lambda *facts: elements.append(Element(*facts)))
    reader.read(file)
    with _opened(file) as stream:
        text = stream.read()
    starts = [element.start for element in elements]
    stops = dict(zip(starts, [*starts[1:], reader.end], strict=True))
    pieces = [text[element.start : stops[element.start]] for element in _sorted(elements)]
    copy = folder / f"sorted-{len(list(folder.iterdir()))}-{file.name.removesuffix('.gz')}"
    copy.write_bytes(b"".join([text[: starts[0]], *pieces, text[reader.end :]]))
    return copy


def is_put_in_order(content: DemandFile) -> bool:
    """Return whether SUMO is given a sorted copy of a file."""
    return bool(content.late) and content.sortable


def first_departure_s(files: Iterable[Path], begin_s: float) -> float | None:
    """Return when the first vehicle, or flow of vehicles, departs, s; None if none does at a known time.

    begin_s: of the simulation; what departs before it never drives.
    """
    contents = [read_demand(path, begin_s) for file in files for path in with_includes(file)]
    return min((content.first_s for content in contents if content.first_s is not None), default=None)


def refused_types(files: Iterable[Path]) -> list[tuple[Path, str, str]]:
    """Return the vehicle types in use that SUMO's sublane simulation refuses: file, id and lane-change model."""
    contents = {path: read_demand(path) for file in files for path in with_includes(file)}
    used = {name for content in contents.values() for name in content.used}
    for content in contents.values():
        used |= {name for distribution, names in content.members.items() if distribution in used for name in names}
    return [
        (path, name, model)
        for path, content in contents.items()
        for name, model in content.models.items()
        if name in used and model not in SUBLANE_MODELS
    ]


def read_demand(file: Path, begin_s: float = 0.0) -> DemandFile:
    """Return what a file holds. One that cannot be read as XML holds nothing: SUMO says why.

    begin_s: of the simulation.
    """
    state = file.stat()
    return _read(file, state.st_mtime_ns, state.st_size, begin_s)


@lru_cache(maxsize=64)
def _read(file: Path, changed_ns: int, size: int, begin_s: float) -> DemandFile:
    """Read a file, once for all episodes of a process as long as it does not change."""
    late, first_s, latest, departures, sortable = list[str](), float("inf"), NEVER, 0, True

    def note(start: int, name: str, identity: str, depart_s: float | None) -> None:
        nonlocal first_s, latest, departures, sortable
        sortable = sortable and name in STANDING_ALONE
        if depart_s is None:
            return
        departures += 1
        if depart_s < latest:
            late.append(identity)
        else:
            latest = depart_s
        if begin_s <= depart_s < first_s and name in VEHICLES:
            first_s = depart_s

    reader = _Reader(begin_s, note)
    try:
        reader.read(file)
    except (expat.ExpatError, EOFError, OSError):
        return DemandFile()
    known_s = first_s if first_s < float("inf") else None
    return DemandFile(departures, tuple(late), sortable, known_s, reader.models, frozenset(reader.used), reader.members)


def _sorted(elements: list[Element]) -> list[Element]:
    """Return the elements with all definitions first, and the others by departure; equal ones stay in their order.

    One that departs at no known time, such as a vehicle that waits for a person, stays behind the one above it.
    """
    keys, latest = [], NEVER
    for element in elements:
        latest = latest if element.depart_s is None else element.depart_s
        keys.append((False, NEVER) if element.name in DEFINITIONS else (True, latest))
    return [elements[k] for k in sorted(range(len(keys)), key=keys.__getitem__)]


def _opened(file: Path) -> IO[bytes]:
    """Return a file, unpacked, open for reading."""
    with file.open("rb") as stream:
        packed = stream.read(len(GZIP)) == GZIP
    return cast(IO[bytes], gzip.open(file)) if packed else file.open("rb")


class _Reader:
    """Reads a file, and calls `note` with each element below its root.

    note: takes where the element's text starts, bytes, its name, its id, and when it departs, s, or None.
    end: where the text after the last element starts. models, used, members: as in `DemandFile`.
    """

    def __init__(self, begin_s: float, note: Callable[[int, str, str, float | None], object]) -> None:
        self.models: dict[str, str] = {}
        self.used: set[str] = set()
        self.members: dict[str, set[str]] = {}
        self.end = 0
        self._begin_s, self._note = begin_s, note
        self._depth = 0
        self._distribution = ""

    def read(self, file: Path) -> None:
        """Read a file. Raises ExpatError where it is not XML or declares a document type, OSError and EOFError."""
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._started
        self._parser.EndElementHandler = self._ended
        self._parser.StartDoctypeDeclHandler = _refuse_document_type
        with _opened(file) as stream:
            self._parser.ParseFile(stream)

    def _started(self, name: str, attributes: dict[str, str]) -> None:
        if self._depth == 1:
            depart_s = self._depart_s(name, attributes)
            self._note(self._parser.CurrentByteIndex, name, attributes.get("id", ""), depart_s)
        self._depth += 1
        if name in VEHICLES:
            self.used.add(attributes.get("type", DEFAULT_TYPE))
        elif name == "vType":
            self._note_type(attributes.get("id", ""), attributes)
        elif name == "vTypeDistribution":
            self._distribution = attributes.get("id", "")
            self.members.setdefault(self._distribution, set()).update(attributes.get("vTypes", "").split())

    def _note_type(self, identity: str, attributes: dict[str, str]) -> None:
        if model := attributes.get("laneChangeModel"):
            self.models[identity] = model
        if self._distribution:
            self.members[self._distribution].add(identity)

    def _ended(self, name: str) -> None:
        self._depth -= 1
        if name == "vTypeDistribution":
            self._distribution = ""
        if not self._depth:
            self.end = self._parser.CurrentByteIndex

    def _depart_s(self, name: str, attributes: dict[str, str]) -> float | None:
        """Return when an element departs; None for one that waits for another, or departs at no time."""
        if name in DEPARTS:
            text = attributes.get("depart", "")
        elif name in BEGINS:
            if "begin" not in attributes:
                return self._begin_s
            text = attributes["begin"]
        else:
            return None
        with suppress(ValueError):
            return seconds(text)
        return None


def _refuse_document_type(*_: object) -> None:
    raise expat.ExpatError("declares a document type")
