"""States that lie where their vehicle cannot have driven to: one wrong coordinate would make the road longer.

Only those count that lie beyond everything else along the road. A wrong position in between makes no road, and
`jumps` finds it.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.jumps import MOST_JUMPING, MOST_OFF_M
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array

MOST_MPS = 150.0
"""No vehicle is faster."""
MOST_ROAD_M = 100_000.0
"""No camera sees a longer road."""
AT_ONCE = 64
"""So many vehicles, of those that are seen farthest at each end, are looked at together."""


def strays(vehicle: Int32Array, tick: IntArray, ticks_per_s: float, along: Array) -> BoolArray:
    """Return which states at the ends of a road lie where their vehicle cannot have driven to, shape (n,).

    vehicle: number. tick: time, in whole ticks. along: position along the road, m. All of shape (n,), in any order.
    """
    found = np.zeros(len(vehicle), bool)
    vehicles = int(vehicle.max(initial=-1)) + 1
    low, high = np.full(vehicles, np.inf), np.full(vehicles, -np.inf)
    np.minimum.at(low, vehicle, along)
    np.maximum.at(high, vehicle, along)
    checked = np.zeros(len(low), bool)
    while True:
        outermost = np.concatenate([np.argsort(low)[:AT_ONCE], np.argsort(-high)[:AT_ONCE]])
        new = np.unique(outermost[~checked[outermost]])
        if not len(new):
            return np.asarray(found & ((along < low.min()) | (along > high.max())))
        checked[new] = True
        rows = np.flatnonzero(np.isin(vehicle, new))
        rows = rows[np.lexsort((tick[rows], vehicle[rows]))]
        for number, own in zip(new.tolist(), np.split(rows, np.searchsorted(vehicle[rows], new[1:])), strict=True):
            away = _away(tick[own] / ticks_per_s, along[own])
            found[own[away]] = True
            low[number] = along[own[~away]].min(initial=np.inf)
            high[number] = along[own[~away]].max(initial=-np.inf)


def _away(time_s: Array, along: Array) -> BoolArray:
    """Return which states of a vehicle, in the order of time, cannot be reached from its longest stretch of driving."""

    def too_far(first: int, later: int) -> bool:
        return bool(abs(along[later] - along[first]) > MOST_OFF_M + MOST_MPS * (time_s[later] - time_s[first]))

    away = np.zeros(len(along), bool)
    cuts = np.flatnonzero(np.abs(np.diff(along)) > MOST_OFF_M + MOST_MPS * np.diff(time_s)) + 1
    spans = list(pairwise([0, *cuts.tolist(), len(along)]))
    longest = max(range(len(spans)), key=lambda k: spans[k][1] - spans[k][0])
    for onward in (range(longest + 1, len(spans)), range(longest - 1, -1, -1)):
        kept = longest
        for k in onward:
            if too_far(spans[min(k, kept)][1] - 1, spans[max(k, kept)][0]):
                away[slice(*spans[k])] = True
            else:
                kept = k
    return away


def check_strays(found: BoolArray, vehicle: Int32Array, along: Array, number: Int32Array, where: Path) -> list[str]:
    """Return what is to be said of states that are left out, a line if there are any.

    found: which they are. vehicle, along: see `strays`. number: of the rows in the file. All of shape (n,). Raises
    InputError where most vehicles have some, or the road is too long without them.
    """
    rows, told = np.flatnonzero(found), ""
    if len(rows):
        rest = (vehicle == vehicle[rows[0]]) & ~found
        away_m = float(np.abs(along[rest] - along[rows[0]]).min())
        told = f"row {number[rows[0]]} lies {away_m:.3g} m from where its vehicle is otherwise"
        jumping, vehicles = len(np.unique(vehicle[rows])), len(np.unique(vehicle))
        if jumping > MOST_JUMPING * vehicles:
            raise InputError(
                f"{where}: {told}, and so do rows of {jumping} of {vehicles} vehicles; fix their positions"
            )
    first, last = (float(end(along, where=~found, initial=sign * np.inf)) for end, sign in ((np.min, 1), (np.max, -1)))
    if last - first > MOST_ROAD_M:
        far = int(np.argmax(np.where(found, 0.0, np.abs(along - np.median(along)))))
        raise InputError(
            f"{where}: its road would be {(last - first) / 1e3:.0f} km long, for the sake of row {number[far]}; give "
            "positions in the unit of the format"
        )
    return [f"{where.name}: {told}: {len(rows)} such state(s) are left out; fix them"] if len(rows) else []
