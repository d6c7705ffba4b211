"""What a file of trajectories says, whatever its format: vehicles, and where each of them is at evenly spaced steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError

Int32Array = npt.NDArray[np.int32]

MOST_STEPS = 100_000_000
"""Steps from the first state of a file to its last: 11 days at 100 Hz."""
LONGEST_PERIOD_S = 1.0
"""States further apart show no maneuver, s."""


@dataclass(frozen=True)
class FileVehicle:
    """A vehicle as its file describes it. kind: SUMO vehicle class. Lengths in m."""

    id: str
    kind: str
    length_m: float
    width_m: float


@dataclass(frozen=True)
class Rows:
    """States in the order of their file, shape (n,) each.

    vehicle: number of the vehicle. tick: time, in whole ticks. ticks_per_s: milliseconds, or the frames of a
    camera. x, y: front bumper centre, m. lane: number of the lane, -1 if the file names none. speed:
    what the file says, m/s; None if it says nothing. number: the line of the file, or the number of the state in it,
    for messages. No column is a view of another.
    """

    vehicle: Int32Array
    tick: IntArray
    x: Array
    y: Array
    lane: Int32Array
    speed: Float32Array | None
    number: IntArray | Int32Array
    ticks_per_s: float = 1e3

    def __len__(self) -> int:
        return len(self.vehicle)

    def time_s(self, row: int) -> float:
        """Return the time of a row, s."""
        return float(self.tick[row]) / self.ticks_per_s

    def sort(self, order: IntArray) -> None:
        """Put the rows into another order, column by column in place: a long file fills the memory once, not twice."""
        for column in (self.vehicle, self.tick, self.x, self.y, self.lane, self.speed, self.number):
            if column is not None:
                column[...] = column[order]


@dataclass(frozen=True)
class FileStates:
    """States of all vehicles of a file, vehicle after vehicle, each in the order of time, shape (n,) each.

    period_s: time between two steps, s. vehicles: in the order of their ids. starts: row of each vehicle's first state,
    and the number of rows at the end. step: number of the step; its time is `step * period_s`. x, y: front bumper
    centre in the scenario's plane, m. lane: number in the scenario's lanes, -1 where not known. speed, number: as in
    `Rows`.
    """

    period_s: float
    vehicles: tuple[FileVehicle, ...]
    starts: IntArray
    step: IntArray
    x: Array
    y: Array
    lane: Int32Array
    speed: Float32Array | None
    number: IntArray | Int32Array

    def __len__(self) -> int:
        return len(self.step)


def observed(rows: Rows, vehicles: Sequence[FileVehicle], where: object) -> FileStates:
    """Sort the states of a file, in place, by vehicle and time.

    where: the file, for messages. Raises InputError where a vehicle has two states at one time, where the times are not
    evenly spaced, or where there are none.
    """
    if not len(rows):
        raise InputError(f"{where}: holds no state of a vehicle; give another file")
    by_id = np.argsort(np.array([vehicle.id for vehicle in vehicles], object), kind="stable")
    place = np.empty(len(by_id), np.int32)
    place[by_id] = np.arange(len(by_id), dtype=np.int32)
    rows.sort(np.lexsort((rows.tick, place[rows.vehicle])))
    number = place[rows.vehicle]
    same = number[1:] == number[:-1]
    gaps = np.diff(rows.tick)
    if (twice := np.flatnonzero(same & (gaps == 0))).size:
        first = int(twice[0])
        raise InputError(
            f"{where}: vehicle {vehicles[by_id[number[first]]].id} has two states at {rows.time_s(first):g} s "
            f"(rows {rows.number[first]} and {rows.number[first + 1]}); leave one of them out"
        )
    period = _period(gaps[same], rows.ticks_per_s, where)
    del gaps, same
    rest = rows.tick % period
    if (odd := np.flatnonzero(rest != np.bincount(rest).argmax())).size:
        raise InputError(
            f"{where}: row {rows.number[odd[0]]} is at {rows.time_s(odd[0]):g} s, between two of the steps of "
            f"{period / rows.ticks_per_s:g} s that the others have; give states at even intervals"
        )
    del rest, odd
    step = rows.tick // period
    if step.max() - step.min() > MOST_STEPS:
        raise InputError(
            f"{where}: spans {(step.max() - step.min()) * period / rows.ticks_per_s:g} s; cut it into several files"
        )
    present = np.unique(number)
    starts = np.searchsorted(number, np.append(present, len(by_id)))
    kept = tuple(vehicles[by_id[k]] for k in present.tolist())
    return FileStates(period / rows.ticks_per_s, kept, starts, step, rows.x, rows.y, rows.lane, rows.speed, rows.number)


def _period(gaps: IntArray, ticks_per_s: float, where: object) -> int:
    """Return the ticks between two states that most vehicles have. Raises InputError where they are too many."""
    if not len(gaps):
        raise InputError(f"{where}: no vehicle has two states; give a file with trajectories")
    values, counts = np.unique(gaps, return_counts=True)
    period = int(values[counts.argmax()])
    if period / ticks_per_s > LONGEST_PERIOD_S:
        raise InputError(
            f"{where}: the states of a vehicle are {period / ticks_per_s:g} s apart, and a maneuver takes no longer; "
            f"give states at most {LONGEST_PERIOD_S:g} s apart"
        )
    return period
