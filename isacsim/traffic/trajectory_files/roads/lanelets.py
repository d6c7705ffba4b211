"""The lanes of a Lanelet2 map, as they lie beside the recordings of exiD, inD, rounD and uniD.

Format: OSM XML as Lanelet2 1.2 describes it (Poggenhans et al., ITSC 2018). A node has a longitude and a latitude, a
way a list of nodes, and a relation of type `lanelet` one way as its left border and one as its right; in the maps of
inD and rounD, a border may be several ways, in any order. Borders may point either way: a lanelet is driven so that its
left border lies on the left. Lanelets that share a whole border are lanes of one road; one that begins with the points
at which another ends continues it. Traffic is taken to keep to the right. A lanelet is driven one way, and one with
`one_way=no` is a second lane, `-ID`, that is driven the other way. What an editor has marked as deleted is not there,
and tags `local_x` and `local_y` are not read.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.xml_files import Element, elements
from isac_cosim.isacsim.traffic.trajectory_files.roads.planes import in_utm

ENDINGS = (".osm", ".osm.gz")
PLACE = re.compile(r"(?:location\D*)?0*(\d+)(?!\d)")
"""How the name of a map begins: `location2.osm`, or `2_merklingen.osm`."""
DRIVEN = frozenset({"road", "highway", "play_street", "emergency_lane", "bus_lane", "exit"})
"""Subtypes of lanelets that vehicles drive in; one without a subtype is a road."""
BORDERS = ("left", "right")
"""Roles of the ways that a lanelet lies between."""
ONE_WAY = ("one_way:vehicle:car", "one_way:vehicle", "one_way")
"""Tags that say whether vehicles drive along a lanelet one way, that which counts first."""
PARTICIPANT = "participant:"
"""Where tags begin with it, they say who uses a lanelet, whatever its subtype."""
MOST_ELEMENTS = 2_000_000
"""A map of one place has fewer, and its borders fewer points; those of levelX have some ten thousand."""
MOST_LANES = 32
"""Lanes side by side, and lanelets with one border."""
MOST_WAYS = 100
"""Ways that make one border."""
MOST_AWAY_M = 20_000.0
"""No lane is so far from the origin of its recording, m."""
READABLE_WIDTHS_M = (0.5, 30.0)
"""Lanes are so wide, on average."""
TOO_LARGE = "is larger than the map of any recording; cut out the place of this one"
MOST_CROSSED_M = 0.5
"""Borders that meet, as where a lane begins, may cross by so much, m."""


@dataclass(frozen=True)
class _Lanelet:
    """Borders in the direction of driving: the ways, the first and last nodes (left, right), and points x + iy, m."""

    id: str
    ways: tuple[frozenset[str], frozenset[str]]
    starts: tuple[str, str]
    ends: tuple[str, str]
    left: ComplexArray
    right: ComplexArray

    def turned(self) -> _Lanelet:
        """Return the same lanelet, driven the other way."""
        return _Lanelet(f"-{self.id}", self.ways[::-1], self.ends[::-1], self.starts[::-1], self.right[::-1],
                        self.left[::-1])  # fmt: skip


@dataclass
class _Map:
    """What is read of a map. nodes: longitude and latitude, degrees. ways: their nodes. relations: their ways, by role.

    tags: of relations."""

    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    ways: dict[str, list[str]] = field(default_factory=dict)
    relations: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    tags: dict[str, dict[str, str]] = field(default_factory=dict)


def is_lanelet_map(where: str | Path) -> bool:
    """Return whether a file is a Lanelet2 map, by its name."""
    return str(where).endswith(ENDINGS)


def lanelet_map_beside(tracks: Path, location: str) -> Path | None:
    """Return the map of a recording: the only one beside it, or that of its location where levelX puts it.

    location: number of the place. None where there is none. Raises InputError where that place has several, as with and
    without a construction site.
    """
    beside = sorted(tracks.parent.glob("*.osm"))
    above = [path for name in ("maps", "lanelets") for path in sorted((tracks.parent.parent / name).rglob("*.osm"))]
    of_location = [path for path in beside or above if (named := PLACE.match(path.stem)) and named[1] == location]
    found = beside if len(beside) == 1 else of_location
    if len(found) > 1:
        raise InputError(
            f"{tracks}: its place, {location}, has the maps {found[0]} and {found[1]}; name that of this recording by "
            "--network"
        )
    return found[0] if found else None


def lanelet_lanes(file: Path, origin: tuple[float, float]) -> tuple[tuple[Lane, ...], list[str]]:
    """Return the lanes of a Lanelet2 map for vehicles, in the coordinates of a recording, and remarks, a line each.

    origin: of these coordinates, m in UTM. Raises InputError where the map cannot be read or holds no lane.
    """
    held = _read(file)
    points = _in_plane(held, file, origin)
    driven = {name: roles for name, roles in held.relations.items() if _is_driven(held.tags[name])}
    borders = [way for roles in driven.values() for role in BORDERS for way in roles.get(role, ())]
    if sum(len(held.ways.get(way, ())) for way in borders) > MOST_ELEMENTS:
        raise InputError(f"{file}: {TOO_LARGE}")
    if borders and (most := Counter(borders).most_common(1)[0])[1] > MOST_LANES:
        raise InputError(f"{file}: way {most[0]:.60} is a border of more than {MOST_LANES} lanelets; fix the map")
    lanelets = [_lanelet(name, roles, held, points, f"{file}: lanelet {name}") for name, roles in driven.items()]
    back = [lanelet.turned() for lanelet in lanelets if _is_two_way(held.tags[lanelet.id])]
    if twice := [lanelet.id for lanelet in back if lanelet.id in driven]:
        raise InputError(f"{file}: lanelet {twice[0]:.60}: another one has this name, driven backwards; rename it")
    lanelets += back
    if not lanelets:
        raise InputError(f"{file}: has no lanelet for vehicles; give the Lanelet2 map of that place")
    following: dict[tuple[str, str], list[str]] = defaultdict(list)
    for lanelet in lanelets:
        following[lanelet.starts].append(lanelet.id)
    roads = _roads(lanelets, file)
    lanes = tuple(
        _lane(lanelet, *roads[lanelet.id], tuple(sorted(following[lanelet.ends])), file) for lanelet in lanelets
    )
    return lanes, _remarks(lanelets, file)


def _is_driven(tags: Mapping[str, str]) -> bool:
    """Return whether a relation is a lanelet for vehicles."""
    users = {name for name, value in tags.items() if name.startswith(PARTICIPANT) and value == "yes"}
    if any(name.startswith(PARTICIPANT) for name in tags):
        suited = any(name.startswith(f"{PARTICIPANT}vehicle") for name in users)
    else:
        suited = tags.get("subtype", "road") in DRIVEN
    return tags.get("type") == "lanelet" and suited


def _is_two_way(tags: Mapping[str, str]) -> bool:
    """Return whether vehicles drive along a lanelet in both directions."""
    return next((tags[name] for name in ONE_WAY if name in tags), "yes") in ("no", "false")


def _remarks(lanelets: list[_Lanelet], file: Path) -> list[str]:
    """Return what is to be said of lanelets that lie side by side with different ends."""
    by_way: dict[str, list[_Lanelet]] = defaultdict(list)
    for lanelet in lanelets:
        for way in lanelet.ways[0]:
            by_way[way].append(lanelet)
    partly = dict.fromkeys(
        f"{lanelet.id} and {other.id}"
        for lanelet in lanelets
        for way in sorted(lanelet.ways[1])
        for other in by_way[way]
        if other.ways[0] != lanelet.ways[1]
    )
    if not partly:
        return []
    return [
        f"{file.name}: {len(partly)} pair(s) of lanelets share a part of a border, such as {next(iter(partly))}: "
        "changes between them are no lane changes; split them where one of them ends"
    ]


def _read(file: Path) -> _Map:
    held, inside = _Map(), Element(0, "", {})
    for count, element in enumerate(elements(file)):
        depth, name, attributes = element
        if depth == 0 and name != "osm":
            raise InputError(f"{file}: is no Lanelet2 map: its first element is {name:.60}, not osm; give a .osm file")
        if count > MOST_ELEMENTS:
            raise InputError(f"{file}: {TOO_LARGE}")
        if depth == 1:
            inside = Element(0, "", {}) if attributes.get("action") == "delete" else element
            identity = attributes.get("id", "")
            kinds: dict[str, Collection[str]] = {"node": held.nodes, "way": held.ways, "relation": held.relations}
            known = kinds.get(inside.name)
            if known is None:
                continue
            if not identity or identity in known:
                raise InputError(f"{file}: two {name}s have the id '{identity:.60}', or it has none; give each its own")
            if name == "node":
                held.nodes[identity] = _degrees(attributes, f"{file}: node {identity:.60}")
            elif name == "way":
                held.ways[identity] = []
            else:
                held.relations[identity], held.tags[identity] = defaultdict(list), {}
        elif depth == 2 and name == "nd" and inside.name == "way":
            held.ways[inside.attributes["id"]].append(attributes.get("ref", ""))
        elif depth == 2 and inside.name == "relation":
            if name == "tag":
                held.tags[inside.attributes["id"]][attributes.get("k", "")] = attributes.get("v", "")
            elif name == "member" and attributes.get("type") == "way":
                held.relations[inside.attributes["id"]][attributes.get("role", "")].append(attributes.get("ref", ""))
    return held


def _degrees(attributes: Mapping[str, str], where: str) -> tuple[float, float]:
    try:
        longitude, latitude = float(attributes["lon"]), float(attributes["lat"])
    except (KeyError, ValueError):
        longitude = latitude = float("nan")
    if not (abs(longitude) <= 180.0 and abs(latitude) <= 84.0):
        raise InputError(f"{where}: has no lon and lat that UTM covers, degrees; fix them")
    return longitude, latitude


def _in_plane(held: _Map, file: Path, origin: tuple[float, float]) -> dict[str, complex]:
    """Return the nodes as x + iy, m."""
    if not held.nodes:
        raise InputError(f"{file}: has no points; give the Lanelet2 map of that place")
    longitude, latitude = np.array(list(held.nodes.values())).T
    east, north = in_utm(longitude, latitude)
    return dict(zip(held.nodes, ((east - origin[0]) + 1j * (north - origin[1])).tolist(), strict=True))


def _lanelet(
    name: str, roles: Mapping[str, list[str]], held: _Map, points: Mapping[str, complex], where: str
) -> _Lanelet:  # fmt: skip
    """Return a lanelet with its borders turned into the direction of driving. Raises InputError where they are none."""
    borders: list[tuple[frozenset[str], list[str], ComplexArray]] = []
    for role in BORDERS:
        ways = list(dict.fromkeys(roles.get(role, [])))
        nodes = _joined(ways, role, held, where)
        if lost := [node for node in nodes if node not in points]:
            raise InputError(f"{where}: node {lost[0]:.60} of its {role} border is not in the file; fix the map")
        borders.append((frozenset(ways), nodes, np.array([points[node] for node in nodes])))
    (left_ways, left_nodes, left), (right_ways, right_nodes, right) = borders
    if both := left_ways & right_ways:
        raise InputError(f"{where}: has way {min(both)} on both sides; fix the map")
    if np.abs(np.concatenate([left, right])).max() > MOST_AWAY_M:
        far = f"is more than {MOST_AWAY_M / 1e3:g} km from the recording"
        raise InputError(f"{where}: {far}; give the map of its place")
    if abs(left[0] - right[0]) + abs(left[-1] - right[-1]) > abs(left[0] - right[-1]) + abs(left[-1] - right[0]):
        right_nodes, right = right_nodes[::-1], right[::-1]
    area = _signed_area(np.concatenate([right, left[::-1]]))
    if area < 0.0:  # the left border lies on the right: it is driven the other way
        left_nodes, left, right_nodes, right = left_nodes[::-1], left[::-1], right_nodes[::-1], right[::-1]
    if _across(left, right).min() < -MOST_CROSSED_M:
        named = " and ".join(", ".join(sorted(ways))[:60] for ways in (left_ways, right_ways))
        raise InputError(f"{where}: its borders, ways {named}, cross each other; fix the map")
    return _Lanelet(name, (left_ways, right_ways), (left_nodes[0], right_nodes[0]), (left_nodes[-1], right_nodes[-1]),
                    left, right)  # fmt: skip


def _joined(ways: list[str], role: str, held: _Map, where: str) -> list[str]:
    """Return the nodes of a border that is one way, or several of which each goes on where another one ends."""
    if not 1 <= len(ways) <= MOST_WAYS:
        raise InputError(f"{where}: its {role} border has {len(ways)} ways and needs 1 to {MOST_WAYS}; fix the map")
    parts: list[list[str]] = []
    for way in ways:
        nodes = held.ways.get(way)
        if nodes is None or len(nodes) < 2:
            fault = "is not in the file" if nodes is None else f"has {len(nodes)} node(s) and needs two"
            raise InputError(f"{where}: its {role} border, way {way:.60}, {fault}; fix the map")
        parts.append(nodes)
    joined = [*parts.pop(0)]
    while parts:
        ends = (joined[0], joined[-1])
        onward = next((k for k, nodes in enumerate(parts) if nodes[0] in ends or nodes[-1] in ends), None)
        if onward is None:
            named = ", ".join(ways)[:60]
            raise InputError(f"{where}: the ways of its {role} border, {named}, do not follow each other; fix the map")
        nodes = parts.pop(onward)
        if joined[-1] not in (nodes[0], nodes[-1]):
            joined.reverse()
        joined = [*joined, *(nodes if nodes[0] == joined[-1] else nodes[::-1])[1:]]
    return joined


def _signed_area(ring: ComplexArray) -> float:
    """Return the area inside a ring of points, m2; positive where it is gone round counter-clockwise."""
    return float((np.conj(ring) * np.roll(ring, -1)).imag.sum() / 2.0)


def _sampled(left: ComplexArray, right: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the points of both borders at the shares of their lengths at which one of them has a point."""
    shares = []
    for border in (left, right):
        along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(border)))])
        shares.append(along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(border)))
    at = np.unique(np.round(np.concatenate(shares), 9))
    a, b = (np.interp(at, share, border.real) + 1j * np.interp(at, share, border.imag)
            for share, border in zip(shares, (left, right), strict=True))  # fmt: skip
    return a, b


def _across(left: ComplexArray, right: ComplexArray) -> Array:
    """Return how far the left border lies to the left of the right one, along the lane, m."""
    a, b = _sampled(left, right)
    heading = np.gradient((a + b) / 2.0)
    heading /= np.maximum(np.abs(heading), 1e-12)
    return np.asarray((np.conj(heading) * (a - b)).imag)


def _roads(lanelets: list[_Lanelet], file: Path) -> dict[str, tuple[str, int]]:
    """Return the road of each lanelet and its number on it, from the rightmost one.

    A lanelet stands beside the first one whose left border is its right one; where roads part, others there are roads
    of their own.
    """
    to_the_right: dict[str, str] = {}
    by_left: dict[frozenset[str], list[_Lanelet]] = defaultdict(list)
    for lanelet in lanelets:
        by_left[lanelet.ways[0]].append(lanelet)
    taken: set[str] = set()
    for lanelet in lanelets:
        for other in by_left[lanelet.ways[1]]:
            if other.starts[0] == lanelet.starts[1] and other.id not in taken:  # both are driven the same way
                to_the_right[lanelet.id] = other.id
                taken.add(other.id)
                break
    found: dict[str, tuple[str, int]] = {}
    for lanelet in lanelets:
        chain = [lanelet.id]
        while chain[-1] in to_the_right:
            chain.append(to_the_right[chain[-1]])
            if len(chain) > MOST_LANES:
                raise InputError(
                    f"{file}: lanelet {lanelet.id} has more than {MOST_LANES} lanes beside it; fix the map"
                )
        found[lanelet.id] = (f"lanelet_{chain[-1]}", len(chain) - 1)
    return found


def _lane(lanelet: _Lanelet, road: str, index: int, successors: tuple[str, ...], file: Path) -> Lane:
    left, right = _sampled(lanelet.left, lanelet.right)
    middle = (left + right) / 2.0
    steps = np.abs(np.diff(middle))
    length = float(steps.sum())
    width = float(np.average((np.abs(left - right)[1:] + np.abs(left - right)[:-1]) / 2.0, weights=steps + 1e-9))
    if not (length > 0.0 and READABLE_WIDTHS_M[0] <= width <= READABLE_WIDTHS_M[1]):
        raise InputError(
            f"{file}: lanelet {lanelet.id} is {length:.3g} m long and {width:.3g} m wide, and no lane is; fix the map"
        )
    shape = np.column_stack([middle.real, middle.imag])
    return Lane(lanelet.id, road, index, width, length, shape, successors, uneven=True)
