"""The motion source `levelx`: recordings of drivers by drones, in levelXdata's format (highD, exiD, inD, rounD, uniD).

Formats: see `trajectory_files.levelx_tables`. In highD, a position is the upper left corner of a box parallel to the
axes, y points down, `width` is the length of the vehicle, frames count from 1, and direction 1 leads leftward on the
upper half of the image. Lanes lie between the markings that the recording's meta file names.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow as pa

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
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
from isac_cosim.isacsim.traffic.trajectory_files.marked_lanes import Carriageway, lanes_and_numbers
from isac_cosim.isacsim.traffic.trajectory_files.observed import Rows, observed

MARKINGS = {"upper": "upperLaneMarkings", "lower": "lowerLaneMarkings"}
"""The columns that name the y of markings, m, by the half of the image."""
LEFTWARD, RIGHTWARD = 1, 2
MOST_AGAINST = 0.5
"""Where a larger share of the vehicles drives against its direction, an axis is turned."""


class LevelxSettings(FileSettings):
    """How recordings by drones become episodes."""


@dataclass(frozen=True)
class LevelxSource(FileSource):
    """Drivers that a drone has filmed, in the format of levelXdata."""

    levelx: LevelxSettings
    sections: ClassVar = {"levelx": LevelxSettings}

    @property
    def settings(self) -> LevelxSettings:
        return self.levelx

    def file_at(self, where: Path) -> Path:
        return files_of(where).tracks

    def files_beside(self, where: Path) -> tuple[Path, ...]:
        files = files_of(where)
        return files.tracks_meta, files.recording_meta

    def open(self, where: Path) -> Opened:
        files = files_of(where)
        if not files.has_corners:
            raise InputError(f"{where}: names centres of boxes; only highD, which names corners, is read")
        return _with_markings(self.levelx, files)


def _with_markings(settings: LevelxSettings, files: LevelxFiles) -> Opened:
    """Return a recording whose lanes lie between straight markings, as those of highD do."""
    where = files.tracks
    meta, rate_hz = read_recording_meta(files.recording_meta, dict.fromkeys(MARKINGS.values(), pa.string()))
    read, remarks = read_tracks(files)
    assert read.direction is not None  # the format has it
    forward = (read.direction == RIGHTWARD)[read.vehicle]
    front, y = read.x + np.where(forward, read.length, 0.0), -(read.y + read.width / 2.0)
    _check_directions(read, front, forward, where)
    start, end = float(np.floor(read.x.min())), float(np.ceil((read.x + read.length).max()))
    halves = [
        Carriageway(half, markings, half == "lower", start, end)
        for half, column in MARKINGS.items()
        if len(markings := _markings(meta[column], column, files.recording_meta))
    ]
    if not halves:
        raise InputError(f"{files.recording_meta}: row 2: names no lane markings; fetch it again")
    lanes, lane = lanes_and_numbers(halves, y, [forward == half.forward for half in halves])
    if (off := float((lane < 0).mean())) > MOST_OFF_ROAD:
        raise InputError(
            f"{where}: {off:.0%} of its positions are beyond the markings that {files.recording_meta.name} names, such "
            f"as row {read.number[np.argmax(lane < 0)]}; put the files of one recording together"
        )
    rows = Rows(
        read.vehicle, read.frame, front, y, lane, None if read.speed is None else read.speed.astype(np.float32),
        read.number, rate_hz,
    )  # fmt: skip
    states = observed(rows, read.vehicles, where)
    noise_m = settings.noise_m
    if noise_m is None:
        noise_m = noise_of_rounding(rounding_of(read.x, read.y))
    remarks = [*check_observed(settings, states, LanePlaces(lanes), where), *remarks]
    sites = sites_for(settings, (), lanes, states, (0.0, 0.0), False)
    place = Scenario(
        scenario_name(where, (TRACKS,)), files.recording_meta, (where,), (), (0.0, 0.0), lanes, sites
    )  # fmt: skip
    inputs = (where, files.tracks_meta, files.recording_meta)
    return Opened(
        place, states, inputs if settings.sites is None else (*inputs, Path(settings.sites)), noise_m, tuple(remarks)
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
            f"{where}: row 2: {column} is {text:.60}; give the y of two or more markings, m, ascending, with ';' between"
        )
    return -down[::-1]


LEAST_LANE_M = 1.0
"""Markings that are closer together, m, have no lane between them."""


def _check_directions(read: LevelxRows, front: Array, forward: Array, where: Path) -> None:
    """Raise InputError where most vehicles drive against the direction that the file names."""
    order = np.lexsort((read.frame, read.vehicle))
    vehicle = read.vehicle[order]
    first = np.flatnonzero(np.concatenate([[True], vehicle[1:] != vehicle[:-1]]))
    last = np.append(first[1:], len(vehicle)) - 1
    driven = front[order][last] - front[order][first]
    moved = np.abs(driven) > LEAST_DRIVEN_M
    against = moved & ((driven > 0.0) != forward[order][first])
    if against.sum() > MOST_AGAINST * moved.sum():
        row = int(read.number[order][first[np.argmax(against)]])
        raise InputError(
            f"{where}: row {row}: vehicle {read.vehicles[vehicle[first[np.argmax(against)]]].id} and most others drive "
            "against their drivingDirection; give x as highD does, or the meta file of this recording"
        )


LEAST_DRIVEN_M = 5.0
"""A vehicle that is driven less far, m, does not show its direction."""
