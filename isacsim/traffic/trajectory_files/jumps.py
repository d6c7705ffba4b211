"""Where positions jump as no vehicle moves: a wrong value in a file, or a vehicle that was taken for another one.

Between two states, a vehicle moves nearly as it did before, or as it does afterwards. An interval whose displacement
fits neither of its neighbours is a jump: both intervals at a state that lies elsewhere, and the one between two states
from which on everything lies elsewhere.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates
from isac_cosim.isacsim.traffic.trajectory_files.tracks import LONGEST_GAP_S

MOST_OFF_M = 1.0
"""A displacement differs from that of its neighbours by less than this, m, and by what the next two allow."""
MOST_CHANGE_MPS2 = 15.0
"""Vehicles change their velocity more slowly."""
MOST_NOISE = 10.0
"""Noise changes a displacement by less than so many times its standard deviation."""
MOST_JUMPING = 0.5
"""Where a larger share of the vehicles jump within a lane, it is not a few values that are wrong."""
AT_ONCE = 50_000
"""So many intervals are compared at once."""


def jumps(observed: FileStates, noise_m: float) -> IntArray:
    """Return the rows after which a vehicle's position jumps, ascending. noise_m: standard deviation of positions."""
    rows = len(observed)
    same = np.ones(rows, bool)  # whether the next row is the next state of the same vehicle, soon after
    same[observed.starts[1:] - 1] = False
    found = [np.empty(0, np.int64)]
    for first in range(0, rows, AT_ONCE):
        low, high = max(first - 1, 0), min(first + AT_ONCE + 2, rows)
        part = slice(low, high)
        here = _jumps(
            observed.step[part], observed.x[part], observed.y[part], same[part], observed.period_s, noise_m
        )  # fmt: skip
        inside = np.flatnonzero(here) + low
        found.append(inside[(inside >= first) & (inside < first + AT_ONCE)])
    return np.concatenate(found)


def _jumps(step: IntArray, x: Array, y: Array, same: BoolArray, period_s: float, noise_m: float) -> BoolArray:
    """Return which of the intervals between so many rows are jumps, one fewer. Neighbours outside count as missing."""
    steps = np.where(same[:-1], np.diff(step), 1)
    time_s = steps * period_s
    near = same[:-1] & ((time_s <= LONGEST_GAP_S) | (steps == 1))
    moved = np.diff(x) + 1j * np.diff(y)

    def unlike(shift: int) -> tuple[BoolArray, BoolArray]:
        """Return which intervals have a neighbour there, and which of them do not move like it."""
        other = np.roll(np.arange(len(near)), shift)
        there = near & near[other]
        there[0 if shift > 0 else -1] = False
        ratio = time_s / time_s[other]
        allowed = MOST_OFF_M + MOST_CHANGE_MPS2 * time_s * (time_s + time_s[other]) / 2.0
        off = np.abs(moved - moved[other] * ratio) > allowed + MOST_NOISE * noise_m * (1.0 + ratio)
        return there, there & off

    if not len(near):
        return np.zeros(0, bool)
    (before, unlike_before), (after, unlike_after) = unlike(1), unlike(-1)
    return np.asarray(near & (before | after) & (unlike_before | ~before) & (unlike_after | ~after))


def check_jumps(observed: FileStates, rows: IntArray, where: object) -> list[str]:
    """Return what is to be said of jumps, a line if there are any.

    Raises InputError where most vehicles jump without a change of lane. rows: those after which they do.
    """
    if not len(rows):
        return []
    vehicle = np.searchsorted(observed.starts, rows, side="right") - 1
    row = int(rows[0])
    length_m = float(np.hypot(observed.x[row + 1] - observed.x[row], observed.y[row + 1] - observed.y[row]))
    time_s = observed.step[row] * observed.period_s
    told = (
        f"as none moves, such as {observed.vehicles[vehicle[0]].id} by {length_m:.3g} m after {time_s:g} s "
        f"(row {observed.number[row + 1]})"
    )
    within = len(np.unique(vehicle[observed.lane[rows] == observed.lane[rows + 1]]))
    if within > MOST_JUMPING * len(observed.vehicles):
        raise InputError(f"{where}: {within} of {len(observed.vehicles)} vehicles jump {told}; fix their positions")
    jumping = len(np.unique(vehicle))
    return [f"{jumping} vehicle(s) jump {told}: their tracks are cut there"]
