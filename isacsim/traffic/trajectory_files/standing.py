"""Vehicles that stand do not move sideways, whatever a camera says."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import runs
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array

SLOW_MPS = 1.0
"""Below this speed a camera's jitter is no motion, m/s."""
OVER_S = 1.0
"""Time over which the speed is told, s."""


def steadied(along: Array, left: Array, time_s: Array, vehicle: Int32Array) -> Array:
    """Return lateral positions, m, that change no faster than a vehicle moves along the road, shape (n,).

    Where a vehicle is slower than `SLOW_MPS`, it moves from its lateral position before to that after in proportion to
    the distance that it covers meanwhile. along, left: positions, m. time_s: times, s. vehicle: number; the states of
    one follow each other in the order of time. All of shape (n,).
    """
    steady = left.copy()
    for first, after in runs(vehicle.astype(np.int64)):
        x, y, t = along[first:after], left[first:after], time_s[first:after]
        before = np.maximum(np.searchsorted(t, t - OVER_S / 2.0), 0)
        later = np.minimum(np.searchsorted(t, t + OVER_S / 2.0, side="right") - 1, len(t) - 1)
        slow = np.abs(x[later] - x[before]) < SLOW_MPS * (t[later] - t[before])
        for start, stop in runs(slow.astype(np.int64)):
            if not slow[start]:
                continue
            if start == 0 and stop == len(t):
                steady[first:after] = np.median(y)
                continue
            low = y[start - 1] if start else y[stop]
            high = y[stop] if stop < len(t) else low
            driven = np.maximum.accumulate(x[start:stop]) - x[start]
            share = driven / driven[-1] if driven[-1] > 0.0 else np.zeros(stop - start)
            steady[first + start : first + stop] = low + (high - low) * share
    return steady
