"""The road as the network knows it: where lanes are and which way they lead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.scenarios.lane import Lane

SPACING_M = 2.0
"""Distance between the points that stand for a lane, m."""
NEAR_M = 5.0
"""A vehicle is at most this far from the middle of a lane that it drives on, m."""
LEAST_ALIKE = 0.5
"""A lane leads the way of a vehicle where the cosine between its direction and the heading is not less."""
MOST_LANES = 12
"""Points near a place that are considered."""


class RoadMap:
    """Points along all lanes with their directions."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        places, directions, dead_ends = [], [], []
        for lane in lanes:
            steps = np.diff(lane.shape, axis=0)
            for begin, step in zip(lane.shape[:-1], steps, strict=True):
                length = float(np.hypot(*step))
                if length == 0.0:
                    continue
                along = np.linspace(0.0, 1.0, max(2, int(np.ceil(length / SPACING_M)) + 1))
                places.append(begin + along[:, None] * step)
                directions.append(np.broadcast_to(step / length, (len(along), 2)))
            if places and not lane.successors:
                dead_ends.append(len(places) - 1)
        self._direction = np.concatenate(directions) if directions else np.empty((0, 2))
        self._tree = cKDTree(np.concatenate(places)) if places else None
        last = np.cumsum([len(of) for of in places], dtype=np.int64) - 1
        self._is_end = np.zeros(last[-1] + 1 if places else 0, dtype=bool)
        self._is_end[last[[number for number in dead_ends if self._leads_nowhere(last[number])]]] = True

    def _leads_nowhere(self, point: int) -> bool:
        """Return whether there is no lane beyond the last point of a lane, beside which others may go on."""
        assert self._tree is not None
        beyond = self._tree.data[point] + 2 * NEAR_M * self._direction[point]
        return bool(self._tree.query(beyond)[0] > NEAR_M)

    def left(self, position: Array) -> BoolArray:
        """Return which places are past an end of the road, and nearer to it than to other lanes, m, (N, 2) -> (N,)."""
        if self._tree is None:
            return np.zeros(len(position), dtype=bool)
        _, number = self._tree.query(position)
        past = ((position - self._tree.data[number]) * self._direction[number]).sum(axis=-1) > 0.0
        return np.asarray(self._is_end[number] & past)

    def directions(self, position: Array) -> Array:
        """Return the directions of lanes near a place, m, (2,), the nearest first, unit vectors, (n, 2)."""
        if self._tree is None:
            return np.empty((0, 2))
        distance, number = self._tree.query(position, k=MOST_LANES)
        near = np.atleast_1d(number)[np.atleast_1d(distance) <= NEAR_M]
        return np.asarray(self._direction[near])

    def along(self, position: Array, ahead: Array) -> Array:
        """Return the direction of a lane near each place that is nearest to a heading, NaN where none is, (N, 2).

        position: m, (N, 2). ahead: unit vectors of the headings, (N, 2).
        """
        if self._tree is None:
            return np.full(position.shape, np.nan)
        distance, number = self._tree.query(position, k=MOST_LANES)
        near = distance <= NEAR_M
        direction = self._direction[np.where(near, number, 0)]
        cosine = np.where(near, (direction * ahead[:, None]).sum(axis=-1), -np.inf)
        best = cosine.argmax(axis=1)[:, None]
        leads = np.take_along_axis(cosine, best, axis=1) >= LEAST_ALIKE
        return np.where(leads, np.take_along_axis(direction, best[..., None], axis=1)[:, 0], np.nan)

    def distance_m(self, position: Array) -> Array:
        """Return how far places are from the nearest lane's middle, m, (N, 2) -> (N,)."""
        if self._tree is None:
            return np.full(len(position), np.inf)
        return np.asarray(self._tree.query(position)[0])
