"""Where positions in the plane are in lanes: along the centre line, and left of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane

AT_ONCE = 2_000_000
"""At most so many pairs of a position and a segment are compared at once."""
AT_ONCE_NEAR = 256
"""Positions that are compared at once with the segments that may be nearest to one of them."""


@dataclass(frozen=True)
class LanePositions:
    """Positions in one lane, shape (n,) each.

    along: m along the lane, from 0 to its length. left: offset from the centre line, m. heading: of the centre line,
    complex unit vectors. beyond: how far the position lies beyond an end of the lane, m; negative before its start.
    """

    along: Array
    left: Array
    heading: ComplexArray
    beyond: Array


@dataclass(frozen=True)
class _CentreLine:
    """The segments of a lane: start and direction in the plane, length in the plane, m, and where each starts, m."""

    start: ComplexArray
    heading: ComplexArray
    length_m: Array
    station: Array
    stretch: float

    def near(self, position: ComplexArray) -> IntArray:
        """Return the segments of which one is nearest to each position, ascending.

        Where all positions are within r of a point, and the nearest segment within d of it, those further than d + 2 r
        from it are nearest to none.
        """
        middle = position.mean()
        reach = float(np.abs(position - middle).max())
        away = np.sqrt(_squares(middle, self.start, self.heading, self.length_m))
        return np.flatnonzero(away <= away.min() + 2.0 * reach + 1e-6 * (1.0 + np.abs(middle)))


def _squares(position: ComplexArray, start: ComplexArray, heading: ComplexArray, length_m: Array) -> Array:
    """Return the squared distances of positions from segments, m2."""
    offset = (position - start) * np.conj(heading)
    outside = offset.real - np.clip(offset.real, 0.0, length_m)
    return np.asarray(outside**2 + offset.imag**2)


class LanePlaces:
    """Finds places in the lanes of a road network; a lane is named by its number."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        self.lanes = lanes
        self._line = lru_cache(maxsize=None)(self._new_line)

    def _new_line(self, lane: int) -> _CentreLine:
        points = self.lanes[lane].shape @ np.array([1.0, 1.0j])
        steps = np.diff(points)
        lengths = np.abs(steps)
        kept = lengths > 0
        if not kept.any():  # a lane without extent, as inside small junctions
            return _CentreLine(points[:1], np.ones(1, np.complex128), np.zeros(1), np.zeros(1), 1.0)
        ends = np.cumsum(lengths[kept])
        heading = steps[kept] / lengths[kept]
        stretch = self.lanes[lane].length_m / float(ends[-1])
        return _CentreLine(points[:-1][kept], heading, lengths[kept], ends - lengths[kept], stretch)

    def places(self, lane: int, position: ComplexArray) -> LanePositions:
        """Return where positions x + iy, m, shape (n,), are in a lane: nearest to its centre line."""
        line = self._line(lane)
        count = len(line.start)
        nearest = np.zeros(len(position), np.int64)
        if count > 1:
            size = min(AT_ONCE_NEAR, max(1, AT_ONCE // count))
            for first in range(0, len(position), size):
                part = position[first : first + size]
                near = line.near(part)
                found = np.argmin(_squares(part[:, None], line.start[near], line.heading[near], line.length_m[near]), 1)
                nearest[first : first + size] = near[found]
        heading = line.heading[nearest]
        offset = (position - line.start[nearest]) * np.conj(heading)
        raw = line.station[nearest] + offset.real
        length = float(line.station[-1] + line.length_m[-1])
        # In a corner, what is nearest to a vertex keeps the heading of the segment that was found first.
        inner = np.clip(raw, line.station[nearest], line.station[nearest] + line.length_m[nearest])
        beyond = np.where(nearest == count - 1, np.maximum(raw - length, 0.0), 0.0)
        beyond = np.where((nearest == 0) & (raw < 0.0), raw, beyond)
        return LanePositions(inner * line.stretch, np.asarray(offset.imag), heading, beyond)

    def beside(self, a: int, b: int) -> bool:
        """Return whether two lanes are on one edge."""
        return self.lanes[a].edge == self.lanes[b].edge


def runs(values: IntArray) -> list[tuple[int, int]]:
    """Return where runs of equal values start and stop."""
    cuts = np.flatnonzero(values[1:] != values[:-1]) + 1
    edges = [0, *cuts.tolist(), len(values)]
    return list(pairwise(edges)) if len(values) else []
