"""The motion source `ngsim`: recordings of freeway traffic in the format of NGSIM (I-80, US-101).

Format: see `trajectory_files.ngsim_table`. Positions are those of the front centre, in feet: `Local_Y` along the
section and `Local_X` from its left edge, ten times a second. Lane 1 is the leftmost one; ramps have the highest
numbers. Ids are used again. There is no road network: centre lines are fitted to where vehicles drive in each lane.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

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
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.ngsim_table import NgsimRows, is_ngsim, read_ngsim
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileVehicle, Int32Array, Rows, observed
from isac_cosim.isacsim.traffic.trajectory_files.roads.fitted_lanes import FittedLanes, fitted_lanes
from isac_cosim.isacsim.traffic.trajectory_files.standing import steadied
from isac_cosim.isacsim.traffic.trajectory_files.strays import check_strays, strays
from isac_cosim.isacsim.traffic.trajectory_files.vehicle_types import LONGEST_M

ENDINGS = (".csv.gz", ".csv", ".txt")
KINDS = {1: "motorcycle", 2: "passenger", 3: "truck"}
"""SUMO vehicle classes of `v_Class`."""
LANES = range(1, 9)
"""Numbers of lanes of freeways; others are those of streets, or of places between the lanes of a junction."""
FRAME_MS = 100
USED_AGAIN_MS = 5000
"""A number that comes back after a longer pause is that of another vehicle."""


class NgsimSettings(FileSettings):
    """How a recording of NGSIM becomes episodes. Its positions are less precise than their rounding says."""

    noise_m: float | None = Field(
        0.1,
        ge=0.0,
        le=2.0,
        description="standard deviation of the noise of positions, m; none: that of their rounding",
    )
    location: str | None = Field(
        None, min_length=1, description="which place of a file with several, as its column Location names it"
    )


@dataclass(frozen=True)
class NgsimSource(FileSource):
    """Drivers on a freeway, filmed from a tall building, in the format of NGSIM."""

    ngsim: NgsimSettings
    sections: ClassVar = {"ngsim": NgsimSettings}

    @classmethod
    def recognises(cls, where: Path) -> bool:
        return is_ngsim(where)

    def open(self, where: Path) -> Opened:
        if where.is_dir():
            raise InputError(f"{where}: is a folder; give a file of NGSIM, such as trajectories-0500-0515.txt")
        read = read_ngsim(where, self.ngsim.location)
        remarks = _leave_out_repeats(read)
        read.take(np.lexsort((read.time_ms, read.vehicle)))
        number, vehicles = _vehicles(read, where)
        away = strays(number, read.time_ms, 1e3, read.along)
        remarks += check_strays(away, number, read.along, read.number, where)
        if away.any():
            read.take(np.flatnonzero(~away))
            number = number[~away]
        np.negative(read.across, out=read.across)  # in place: the columns of a long file fill most of the memory
        along, left = read.along, steadied(read.along, read.across, read.time_ms / 1e3, number)
        fitted = fitted_lanes(along, left, np.where(np.isin(read.lane, LANES), read.lane, 0))
        _check_lanes(fitted, read, where)
        # Times are those of the first frame, and go on from there where numbers of frames begin anew.
        first = int(read.time_ms.argmin())
        time_ms = read.time_ms - read.time_ms[first] + read.frame[first] * FRAME_MS
        rows = Rows(number, time_ms, along, left, fitted.number, read.speed, read.number)
        del read, number, along, left, time_ms
        states = observed(rows, vehicles, where)
        noise_m = self.ngsim.noise_m
        remarks += check_observed(self.ngsim, states, LanePlaces(fitted.lanes), where)
        sites = sites_for(self.ngsim, (), fitted.lanes, states, (0.0, 0.0), False)
        place = Scenario(
            scenario_name(where, ENDINGS), where, (where,), (), (0.0, 0.0), fitted.lanes, sites
        )  # fmt: skip
        inputs = (where,) if self.ngsim.sites is None else (where, Path(self.ngsim.sites))
        return Opened(place, states, inputs, 0.0 if noise_m is None else noise_m, tuple(remarks))


def _leave_out_repeats(read: NgsimRows) -> list[str]:
    """Leave out the rows that say again what one before them says; return how many there are, as a line if any."""
    order = np.lexsort((read.time_ms, read.vehicle))
    again = (np.diff(read.vehicle[order]) == 0) & (np.diff(read.time_ms[order]) == 0)
    at_once = np.zeros(len(order), bool)
    at_once[:-1] = again
    at_once[1:] |= again
    doubtful = np.sort(order[at_once])
    columns = (read.vehicle, read.time_ms, read.lane, read.kind, read.along, read.across)
    same = np.column_stack([column[doubtful] for column in columns])
    _, first = np.unique(same, axis=0, return_index=True)
    if len(first) == len(doubtful):
        return []
    repeated = np.delete(doubtful, first)
    read.take(np.delete(np.arange(len(read)), repeated))
    return [f"{len(repeated)} rows are there twice, and left out once"]


def _vehicles(read: NgsimRows, where: Path) -> tuple[Int32Array, list[FileVehicle]]:
    """Return the number of each row's vehicle, and the vehicles. The rows are in the order of vehicles and time.

    A number that is used again, after a pause or for a vehicle of another size, is that of a new vehicle: `12@2`.
    Raises InputError where a vehicle has no size, or no class.
    """
    same = read.vehicle[1:] == read.vehicle[:-1]
    pause = np.diff(read.time_ms) > USED_AGAIN_MS
    other = (np.diff(read.length) != 0) | (np.diff(read.width) != 0) | (np.diff(read.kind) != 0)
    new = np.concatenate([[True], ~same | pause | other])
    number = (np.cumsum(new) - 1).astype(np.int32)
    vehicles, times = list[FileVehicle](), dict[int, int]()
    for row in np.flatnonzero(new).tolist():
        named, kind = int(read.vehicle[row]), KINDS.get(int(read.kind[row]))
        if kind is None:
            raise InputError(
                f"{where}: row {read.number[row]}: v_Class is {read.kind[row]}; give 1 (motorcycle), 2 (car) or "
                "3 (truck)"
            )
        length_m, width_m = float(read.length[row]), float(read.width[row])
        if not (0.0 < length_m <= LONGEST_M and 0.0 < width_m <= LONGEST_M):
            raise InputError(
                f"{where}: row {read.number[row]}: vehicle {named} is {length_m:.3g} m x {width_m:.3g} m; give more "
                f"than 0 and at most {LONGEST_M:g} m, in feet"
            )
        times[named] = times.get(named, 0) + 1
        vehicles.append(
            FileVehicle(f"{named}@{times[named]}" if times[named] > 1 else str(named), kind, length_m, width_m)
        )
    return number, vehicles


def _check_lanes(fitted: FittedLanes, read: NgsimRows, where: Path) -> None:
    """Raise InputError where the file is not that of a freeway, or its axes are others."""
    off = fitted.number < 0
    if off.mean() > MOST_OFF_ROAD:
        raise InputError(
            f"{where}: {off.mean():.0%} of its positions are in no lane of a freeway ({LANES[0]} to {LANES[-1]}), such "
            f"as row {read.number[int(np.argmax(off))]}; only freeways are read, such as i-80 and us-101"
        )
    if list(fitted.side_by_side) != sorted(fitted.side_by_side):
        raise InputError(
            f"{where}: its lanes are {', '.join(map(str, fitted.side_by_side))} from the left, and lane 1 is the "
            "leftmost one of NGSIM; give Local_X from the left edge of the road, and Local_Y along it"
        )
