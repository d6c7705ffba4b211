"""The motion source `levelx`: recordings of drivers by drones, in levelXdata's format (highD, exiD, inD, rounD, uniD).

Formats: see `trajectory_files.levelx_tables`. In highD, a position is the upper left corner of a box parallel to the
axes, y points down, `width` is the length of the vehicle, frames count from 1, and direction 1 leads leftward on the
upper half of the image. Lanes lie between the markings that the recording's meta file names. In the others, a position
is the centre of a box, `heading` is in degrees counter-clockwise, and frames count from 0; lanes are those of the
Lanelet2 map that comes with them, or of a road network.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
from pydantic import Field

from isac_cosim.base.arrays import Array, BoolArray, ComplexArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.sources.recorded_files import (
    FileSettings,
    FileSource,
    Opened,
    check_observed,
    scenario_name,
    sites_for,
)
from isac_cosim.isacsim.traffic.trajectory_files.checks import MOST_OFF_ROAD
from isac_cosim.isacsim.traffic.trajectory_files.conditioning import noise_of_rounding, rounding_of
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.levelx_tables import (
    TRACKS,
    LevelxFiles,
    LevelxRows,
    files_of,
    read_recording_meta,
    read_tracks,
)
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates, Int32Array, Rows, observed
from isac_cosim.isacsim.traffic.trajectory_files.roads.lane_matching import match_lanes
from isac_cosim.isacsim.traffic.trajectory_files.roads.lanelets import (
    is_lanelet_map,
    lanelet_lanes,
    lanelet_map_beside,
)
from isac_cosim.isacsim.traffic.trajectory_files.roads.marked_lanes import MarkedCarriageway, lanes_and_numbers
from isac_cosim.isacsim.traffic.trajectory_files.roads.planes import net_offset, on_network
from isac_cosim.isacsim.traffic.trajectory_files.strays import check_strays, strays
from isac_cosim.isacsim.traffic.trajectory_files.tables import header_of

MARKINGS = {"upper": "upperLaneMarkings", "lower": "lowerLaneMarkings"}
"""The columns that name the y of markings, m, by the half of the image."""
UTM_ORIGIN = ("xUtmOrigin", "yUtmOrigin")
"""The columns that name the origin of a recording's coordinates, m in UTM."""
RIGHTWARD = 2
NONE = np.empty(0)
AT_ONCE = 250_000
"""So many states are turned and matched to lanes at once."""
MOST_AGAINST = 0.5
"""Where a larger share of the vehicles drives against its direction, an axis is turned."""


class LevelxSettings(FileSettings):
    """How recordings by drones become episodes, and where the road is that they do not name."""

    network: str | None = Field(
        None,
        min_length=1,
        description="Lanelet2 map, network or scenario that was driven on, by default the map beside the recording; "
        "highD needs none; --network names it",
    )


@dataclass(frozen=True)
class LevelxSource(FileSource):
    """Drivers that a drone has filmed, in the format of levelXdata."""

    levelx: LevelxSettings
    sections: ClassVar = {"levelx": LevelxSettings}

    @classmethod
    def recognises(cls, where: Path) -> bool:
        return where.name.endswith(TRACKS) and "frame" in header_of(where)

    def file_at(self, where: Path) -> Path:
        return files_of(where).tracks

    def files_beside(self, where: Path) -> tuple[Path, ...]:
        files = files_of(where)
        return files.tracks_meta, files.recording_meta

    def open(self, where: Path) -> Opened:
        files = files_of(where)
        read = _with_markings if files.has_corners else _on_network
        place, states, rounded, remarks = read(self.levelx, files)
        noise_m = self.levelx.noise_m
        if noise_m is None:
            noise_m = noise_of_rounding(rounded)
        remarks = [*check_observed(self.levelx, states, LanePlaces(place.lanes), where), *remarks]
        sites = sites_for(self.levelx, place.sites, place.lanes, states, place.origin, place.lefthand)
        inputs = [where, files.tracks_meta, files.recording_meta]
        if not files.has_corners:
            inputs.append(place.network)
        if self.levelx.sites is not None:
            inputs.append(Path(self.levelx.sites))
        elif place.sites:
            inputs += place.additional
        place = replace(place, name=scenario_name(where, (TRACKS,)), demand=(where,), additional=(), sites=sites)
        return Opened(place, states, tuple(dict.fromkeys(inputs)), noise_m, tuple(remarks))


_Read = tuple[Scenario, FileStates, float, list[str]]
"""The road of a recording, its states, to what its positions are rounded, m, and what is to be said of it."""


def _with_markings(settings: LevelxSettings, files: LevelxFiles) -> _Read:
    """Return a recording whose lanes lie between straight markings, as those of highD do."""
    where = files.tracks
    if settings.network is not None:
        raise InputError(f"{where}: its lanes lie between the markings that it names; leave out --network")
    meta, rate_hz = read_recording_meta(files.recording_meta, dict.fromkeys(MARKINGS.values(), pa.string()))
    read, remarks = read_tracks(files)
    assert read.direction is not None  # the format has it
    assert read.width is not None
    rounded = rounding_of(read.x, read.y)
    away = strays(read.vehicle, read.frame, rate_hz, read.x)
    remarks += check_strays(away, read.vehicle, read.x, read.number, where)
    if away.any():
        read.leave_out(away)
    start, end = float(np.floor(read.x.min())), float(np.ceil((read.x + read.length).max()))
    forward = (read.direction == RIGHTWARD)[read.vehicle]
    # From corners to the centres of fronts, in place: the columns of a long recording fill most of the memory.
    np.add(read.x, read.length, out=read.x, where=forward)
    read.width /= 2.0
    read.y += read.width
    np.negative(read.y, out=read.y)
    read.length = read.width = NONE
    _check_directions(read, forward, where)
    halves = [
        MarkedCarriageway(half, markings, half == "lower", start, end)
        for half, column in MARKINGS.items()
        if len(markings := _markings(meta[column], column, files.recording_meta))
    ]
    if not halves:
        raise InputError(f"{files.recording_meta}: row 2: names no lane markings; fetch it again")
    lanes, lane = lanes_and_numbers(halves, read.y, [forward == half.forward for half in halves])
    _check_on_road(lane, read, f"beyond the markings that {files.recording_meta.name} names", where)
    vehicles, rows = read.vehicles, _rows(read, lane, rate_hz)
    del read, forward, lane
    place = Scenario("", files.recording_meta, (where,), (), (0.0, 0.0), lanes, ())
    return place, observed(rows, vehicles, where), rounded, remarks


def _on_network(settings: LevelxSettings, files: LevelxFiles) -> _Read:
    """Return a recording that names centres and headings of boxes, on a Lanelet2 map or a road network."""
    where = files.tracks
    columns = {**dict.fromkeys(UTM_ORIGIN, pa.float64()), "locationId": pa.int64()}
    meta, rate_hz = read_recording_meta(files.recording_meta, columns)
    road, remarks = _road(settings, files, meta)
    read, of_tracks = read_tracks(files)
    remarks += of_tracks
    rounded = rounding_of(read.x, read.y)
    _to_fronts(read)
    shifts = [(0.0, 0.0)]
    if not is_lanelet_map(road.network) and None not in (meta[name] for name in UTM_ORIGIN):
        east, north = net_offset(road.network)
        shifts.append((meta[UTM_ORIGIN[0]] + east, meta[UTM_ORIGIN[1]] + north))
    placed = on_network(read.x, read.y, road, shifts)
    if placed is None:
        raise InputError(
            f"{where}: most of its positions, such as {read.x[0]:g}, {read.y[0]:g}, are outside "
            f"{road.network}; name a network of that place, in the recording's own coordinates or in UTM"
        )
    read.x, read.y = placed
    del placed
    lane = _matched(read, LanePlaces(road.lanes))
    _check_on_road(lane, read, f"on no lane of {road.network}", where)
    vehicles, rows = read.vehicles, _rows(read, lane, rate_hz)
    del read, lane
    return road, observed(rows, vehicles, where), rounded, remarks


def _to_fronts(read: LevelxRows) -> None:
    """Move positions from the centres of boxes to those of their fronts, in place; lengths are given up."""
    for first in range(0, len(read.x), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        front = read.x[part] + 1j * read.y[part] + _heading(read, part) * (read.length[part] / 2.0)
        read.x[part], read.y[part] = front.real, front.imag
    read.length = NONE


def _heading(read: LevelxRows, which: slice | IntArray) -> ComplexArray:
    assert read.angle is not None  # the format has it
    return np.exp(1j * np.radians(read.angle[which]))


def _matched(read: LevelxRows, places: LanePlaces) -> Int32Array:
    """Return the number of the lane of each state, -1 where it is on none: some vehicles at a time."""
    order = np.lexsort((read.frame, read.vehicle))
    lane = np.empty(len(order), np.int32)
    ends = np.append(np.flatnonzero(np.diff(read.vehicle[order])) + 1, len(order))
    first = 0
    while first < len(order):
        after = int(ends[min(int(np.searchsorted(ends, first + AT_ONCE)), len(ends) - 1)])
        part = order[first:after]
        position = read.x[part] + 1j * read.y[part]
        lane[part] = match_lanes(places, position, _heading(read, part), read.vehicle[part])
        first = after
    return lane


def _road(settings: LevelxSettings, files: LevelxFiles, meta: Mapping[str, Any]) -> tuple[Scenario, list[str]]:
    """Return the road of a recording, a network or a Lanelet2 map, named or found beside the recording; and remarks."""
    where = settings.network or lanelet_map_beside(files.tracks, str(meta["locationId"]))
    if where is None:
        raise InputError(
            f"{files.tracks}: does not say where lanes are; name a Lanelet2 map or a network of that place by --network"
        )
    if not is_lanelet_map(where):
        return scenario.load_without_sites(str(where)), []
    if not (file := Path(where)).is_file():
        raise InputError(f"there is no file {file}: give the Lanelet2 map of that place, or a network")
    origin = [meta[name] for name in UTM_ORIGIN]
    if not all(value is not None and np.isfinite(value) for value in origin):
        raise InputError(f"{files.recording_meta}: names no xUtmOrigin and yUtmOrigin, by which {file} is placed")
    lanes, remarks = lanelet_lanes(file, (origin[0], origin[1]))
    return Scenario("", file, (files.tracks,), (), (0.0, 0.0), lanes, ()), remarks


def _rows(read: LevelxRows, lane: Int32Array, rate_hz: float) -> Rows:
    return Rows(read.vehicle, read.frame, read.x, read.y, lane, read.speed, read.number, rate_hz)


def _check_on_road(lane: Int32Array, read: LevelxRows, off: str, where: Path) -> None:
    """Raise InputError where too many positions are in no lane. off: where they are, for the message."""
    share = float((lane < 0).mean())
    if share > MOST_OFF_ROAD:
        raise InputError(
            f"{where}: {share:.0%} of its positions are {off}, such as row {read.number[int(np.argmax(lane < 0))]}; "
            "give the road of this recording"
        )


def _markings(text: str | None, column: str, where: Path) -> Array:
    """Return the y of markings in the plane, where y points up, ascending, m. Raises InputError where they are none."""
    if not text or not text.strip(" ;"):
        return np.empty(0)
    try:
        down = np.array([float(part) for part in text.strip(" ;").split(";")])
    except ValueError:
        down = np.full(2, np.nan)
    if len(down) < 2 or not np.isfinite(down).all() or (np.diff(down) < LEAST_LANE_M).any():
        raise InputError(
            f"{where}: row 2: {column} is {text:.60}; give the y of two or more markings, m, ascending, "
            "with ';' between them"
        )
    return -down[::-1]


LEAST_LANE_M = 1.0
"""Markings that are closer together, m, have no lane between them."""


def _check_directions(read: LevelxRows, forward: BoolArray, where: Path) -> None:
    """Raise InputError where most vehicles drive against the direction that the file names."""
    first, last = (np.full(len(read.vehicles), -1) for _ in range(2))
    rows = np.arange(len(read.vehicle))
    last[read.vehicle] = rows  # of several rows of a vehicle, the last one is kept
    first[read.vehicle[::-1]] = rows[::-1]
    first, last = first[first >= 0], last[last >= 0]
    driven = read.x[last] - read.x[first]
    moved = np.abs(driven) > LEAST_DRIVEN_M
    against = moved & ((driven > 0.0) != forward[first])
    if against.sum() > MOST_AGAINST * moved.sum():
        row = int(first[np.argmax(against)])
        raise InputError(
            f"{where}: row {read.number[row]}: vehicle {read.vehicles[read.vehicle[row]].id} and most others drive "
            "against their drivingDirection; give x as highD does, or the meta file of this recording"
        )


LEAST_DRIVEN_M = 5.0
"""A vehicle that is driven less far, m, does not show its direction."""
