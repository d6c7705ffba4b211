"""What a file of vehicles and flows holds, and a copy of it in the order in which SUMO wants them.

SUMO reads a route file while it simulates, and leaves out a vehicle or flow that departs before one above it. Whoever
wrote such a file meant all of them to drive, so SUMO is given a copy with the same elements, sorted.
"""

from __future__ import annotations

import gzip
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from xml.parsers import expat

from isac_cosim.isacsim.scenarios.sumo_files import with_includes
from isac_cosim.isacsim.scenarios.sumo_schemas import seconds
from isac_cosim.isacsim.scenarios.xml_files import GZIP, Element, elements

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
NEVER, NONE_S = float("-inf"), float("inf")


@dataclass(frozen=True)
class DemandFile:
    """What is read of a file of vehicles and flows, without the files that it includes.

    departures: number of elements that depart. late: ids of those that SUMO leaves out, because they depart before one
    above them. sortable: whether every element stands for itself, so that only their order would change. first_s: when
    the first vehicle or flow of vehicles departs after the simulation has begun, s. earliest_s: when the first of all
    does, s; both None if none does at a known time. models: lane-change model of each type that names one. used: types
    that vehicles and flows name. members: types in each distribution.
    """

    departures: int
    late: tuple[str, ...]
    sortable: bool
    first_s: float | None
    earliest_s: float | None
    models: Mapping[str, str]
    used: Collection[str]
    members: Mapping[str, Collection[str]]

    @property
    def is_put_in_order(self) -> bool:
        """Whether SUMO is given a sorted copy of the file."""
        return bool(self.late) and self.sortable


def in_order(file: Path, handed: Path, folder: Path, begin_s: float) -> Path:
    """Return the path of a route file that is sorted by departure: the given one, or that of a sorted copy in a folder.

    handed: what SUMO is given of the file. begin_s: of the simulation. A file stays as it is where its elements do not
    stand for themselves, because it includes others or has intervals.
    """
    if not read_demand(file, begin_s).is_put_in_order:
        return handed
    text = handed.read_bytes()
    text = gzip.decompress(text) if text.startswith(GZIP) else text
    pieces = _Pieces.of(text, begin_s)
    starts = pieces.starts
    stops = dict(zip(starts, [*starts[1:], pieces.end], strict=True))
    copy = folder / f"sorted-{len(list(folder.iterdir()))}.rou.xml"
    parts = [text[start : stops[start]] for start in pieces.in_order()]
    copy.write_bytes(b"".join([text[: starts[0]], *parts, text[pieces.end :]]))
    return copy


def first_departure_s(files: Iterable[Path], begin_s: float) -> float | None:
    """Return when the first vehicle, or flow of vehicles, departs, s; None if none does at a known time.

    begin_s: of the simulation. What departs before it counts only where nothing departs later.
    """
    contents = [read_demand(path, begin_s) for file in files for path in with_includes(file)]
    after = [content.first_s for content in contents if content.first_s is not None]
    return min(after or (content.earliest_s for content in contents if content.earliest_s is not None), default=None)


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
    """Return what a file holds. It is read once for all episodes of a process, as long as it does not change.

    begin_s: of the simulation. Raises InputError where the file cannot be read.
    """
    state = file.stat()
    return _read(file, begin_s, state.st_ino, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=64)
def _read(file: Path, begin_s: float, *_: int) -> DemandFile:
    late, latest, departures, sortable = list[str](), NEVER, 0, True
    first_s = earliest_s = NONE_S
    types = _Types()
    for element in elements(file):
        types.note(element)
        if element.depth != 1:
            continue
        sortable = sortable and element.name in STANDING_ALONE
        depart_s = departure_s(element.name, element.attributes, begin_s)
        if depart_s is None:
            continue
        departures += 1
        if depart_s < latest:
            late.append(element.attributes.get("id", ""))
        else:
            latest = depart_s
        if element.name in VEHICLES:
            earliest_s = min(earliest_s, depart_s)
            if depart_s >= begin_s:
                first_s = min(first_s, depart_s)
    return DemandFile(
        departures=departures,
        late=tuple(late),
        sortable=sortable,
        first_s=first_s if first_s < NONE_S else None,
        earliest_s=earliest_s if earliest_s < NONE_S else None,
        models=types.models,
        used=frozenset(types.used),
        members=types.members,
    )


def departure_s(name: str, attributes: Mapping[str, str], begin_s: float) -> float | None:
    """Return when an element departs, s; None for one that waits for another, or departs at no time.

    begin_s: of the simulation.
    """
    if name in DEPARTS:
        return seconds(attributes.get("depart", ""))
    if name in BEGINS:
        return seconds(attributes["begin"]) if "begin" in attributes else begin_s
    return None


@dataclass
class _Types:
    """The vehicle types of a file: `models`, `used` and `members` as in `DemandFile`."""

    models: dict[str, str] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    members: dict[str, set[str]] = field(default_factory=dict)
    _distribution: tuple[int, str] = (0, "")

    def note(self, element: Element) -> None:
        """Note what an element says of types. Call with all of a file, in their order."""
        depth, name, attributes = element
        if name in VEHICLES:
            self.used.add(attributes.get("type", DEFAULT_TYPE))
        elif name == "vType":
            identity = attributes.get("id", "")
            if model := attributes.get("laneChangeModel"):
                self.models[identity] = model
            if depth == self._distribution[0] + 1 and depth > 1:
                self.members[self._distribution[1]].add(identity)
        elif name == "vTypeDistribution":
            self._distribution = depth, attributes.get("id", "")
            self.members.setdefault(self._distribution[1], set()).update(attributes.get("vTypes", "").split())


class _Pieces:
    """The elements below the root of a text: where each starts, bytes, and where what follows the last one starts."""

    def __init__(self, begin_s: float) -> None:
        self.starts: list[int] = []
        self.end = 0
        self._begin_s = begin_s
        self._keys: list[tuple[bool, float]] = []
        self._latest, self._depth = NEVER, 0
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._started
        self._parser.EndElementHandler = self._ended

    @classmethod
    def of(cls, text: bytes, begin_s: float) -> _Pieces:
        """Return the elements of the text of a file that has been read before, and so is sound."""
        pieces = cls(begin_s)
        pieces._parser.Parse(text, True)
        return pieces

    def in_order(self) -> list[int]:
        """Return the starts of all elements: of definitions first, then of the others by departure.

        Those that depart together stay in their order. One that departs at no known time, such as a vehicle that waits
        for a person, stays behind the one above it.
        """
        return [self.starts[k] for k in sorted(range(len(self.starts)), key=self._keys.__getitem__)]

    def _started(self, name: str, attributes: dict[str, str]) -> None:
        if self._depth == 1:
            depart_s = departure_s(name, attributes, self._begin_s)
            self._latest = self._latest if depart_s is None else depart_s
            self.starts.append(self._parser.CurrentByteIndex)
            self._keys.append((False, NEVER) if name in DEFINITIONS else (True, self._latest))
        self._depth += 1

    def _ended(self, _: str) -> None:
        self._depth -= 1
        if not self._depth:
            self.end = self._parser.CurrentByteIndex
