"""The centre lines of lanes, and how vehicles come from one lane into another between two samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane

SHIFT_M = 0.2
"""No vehicle drives this far aside while it passes the end of a lane, m; the lanes are offset by that much."""
PATH_LANES = 8
"""A vehicle drives through fewer lanes than this from one sample to the next."""


@dataclass(frozen=True)
class LaneSegments:
    """Straight segments of lanes, one for each of n places: where lane_pos and lane_lat lead in the plane.

    numbers: of the segments, (n,). corner: point of lane_pos 0, had the lane only this segment, (2, n), m.
    along, across: of one metre of lane_pos and of lane_lat, (2, n).
    """

    numbers: IntArray
    corner: Array
    along: Array
    across: Array

    def of(self, k: IntArray) -> LaneSegments:
        """Return some of the segments, by their numbers (m,)."""
        return LaneSegments(self.numbers[k], *(of.take(k, axis=1) for of in (self.corner, self.along, self.across)))

    def points(self, lane_pos: Array, lane_lat: Array) -> tuple[Array, Array]:
        """Return points of the plane, x and y, m. lane_pos, lane_lat: (..., n)."""
        (x, y), (along_x, along_y), (across_x, across_y) = self.corner, self.along, self.across
        return x + along_x * lane_pos + across_x * lane_lat, y + along_y * lane_pos + across_y * lane_lat


@dataclass(frozen=True)
class Way:
    """How vehicles get from one lane into another: by driving on, sideways, both, or in no known way.

    lanes: that lead on from one to the next. ends: where each of them but the last ends, m from the beginning of the
    first. beside: the lane next to the first or the last of them that the vehicle comes from (early) or ends in; -1 if
    it only drives on. half_m: from the middle of its lane to the marking. apart_m: from the middle of a lane to that of
    the next one. known: whether there is a way; without one, a vehicle stays in its lane until the next sample.
    """

    lanes: tuple[int, ...]
    ends: tuple[float, ...] = ()
    beside: int = -1
    early: bool = False
    half_m: float = np.inf
    apart_m: float = 0.0
    known: bool = True


@dataclass(frozen=True)
class LaneTransitions:
    """Vehicles that come from one lane into another between two samples, (n,) each.

    ways: of which `number` says which is whose. driven_m, moved_m: distances from sample to sample, along and to the
    left. side: +1 across a marking to the left, -1 to the right, 0 if the vehicle only drives on. apart_m: to the left,
    from the middle of a lane to that of the next one, where it does not simply go on.
    """

    ways: Sequence[Way]
    number: IntArray
    driven_m: Array
    moved_m: Array
    side: Array
    apart_m: Array

    def places(self, which: IntArray, lane_pos: Array, lane_lat: Array) -> tuple[Array, Array, Array]:
        """Return lane, lane_pos and lane_lat of places during crossings, (r,) each.

        which: of the crossings, (r,). lane_pos: from the beginning of the first lane. lane_lat: from the middle of the
        lane that the vehicle is in at first.
        """
        way, side = self.number[which], self.side[which]
        lanes, begins, last, beside, early, half_m = self._table
        passed = np.sum(begins[way, 1:] < lane_pos[:, None], axis=1)
        at_goal = passed == last[way]
        lane = lanes[way, passed]
        within = lane_pos - begins[way, passed]
        across = side * lane_lat > half_m[way]
        across = np.where(early[way], across | (passed > 0), across & at_goal)
        lane = np.where((side != 0.0) & (across != early[way]), beside[way], lane)
        apart_m = np.where(np.where(side != 0.0, across, at_goal), self.apart_m[which], 0.0)
        return lane, within, lane_lat - apart_m

    @cached_property
    def _table(self) -> tuple[npt.NDArray[Any], ...]:
        """Of each way: lanes, where each begins, number of the last one, lane beside, `early` and `half_m`."""
        width = 1 + max((len(way.ends) for way in self.ways), default=0)
        lanes, begins = np.zeros((len(self.ways), width)), np.full((len(self.ways), width), np.inf)
        for row, way in enumerate(self.ways):
            lanes[row, : len(way.lanes)] = way.lanes
            begins[row, : len(way.ends) + 1] = (0.0, *way.ends)
        rest = [(len(way.ends), way.beside, way.early, way.half_m) for way in self.ways]
        return lanes, begins, *(np.array(values) for values in zip(*rest, strict=True))


class Road:
    """The centre lines of lanes, as SUMO reads positions from them."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        """Take the segments of all lanes."""
        self._lanes = lanes
        self._number = {lane.id: k for k, lane in enumerate(lanes)}
        self._ways: dict[tuple[int, int], Way] = {}
        self._of_edge: dict[str, list[int]] = {}
        for k, lane in enumerate(lanes):
            self._of_edge.setdefault(lane.edge, []).append(k)
        ends, corners, along, across = [], [], [], []
        for lane in lanes:
            segment_ends, directions = lane.segments
            start = complex(*lane.shape[0])
            if not len(segment_ends):
                segment_ends, directions = np.array([lane.length_m]), np.ones(1, np.complex128)
                stretch = 0.0
            else:
                stretch = float(np.hypot(*np.diff(lane.shape, axis=0).T).sum()) / lane.length_m
            begins = np.append(0.0, segment_ends[:-1])
            steps = directions * stretch * (segment_ends - begins)
            corner = start + np.append(0.0, np.cumsum(steps)[:-1]) - directions * stretch * begins
            ends.append(segment_ends)
            corners.append(corner)
            along.append(directions * stretch)
            across.append(1j * directions)
        self._ends = ends
        # The first segment of a lane begins, and the last one ends, nowhere.
        self._begin = np.concatenate([[-np.inf, *of_lane[:-1]] for of_lane in ends])
        self._end = np.concatenate([[*of_lane[:-1], np.inf] for of_lane in ends])
        self._segments = np.array([len(of_lane) for of_lane in ends])
        self._first = np.cumsum(self._segments) - self._segments
        self._corner, self._along, self._across = (
            np.stack([values.real, values.imag]) for values in map(np.concatenate, (corners, along, across))
        )

    def places(self, lane: IntArray, lane_pos: Array) -> LaneSegments:
        """Return the segments that places are in. lane: numbers of lanes, (n,). lane_pos: m, (n,)."""
        numbers = self._first[lane]
        bent = np.flatnonzero(self._segments[lane] > 1)
        bent = bent[np.argsort(lane[bent], kind="stable")]
        starts = np.flatnonzero(np.diff(lane[bent], prepend=-1, append=-1))
        for start, stop in pairwise(starts.tolist()):
            of_lane = bent[start:stop]
            ends = self._ends[lane[of_lane[0]]][:-1]
            numbers[of_lane] += np.searchsorted(ends, lane_pos[of_lane], side="right")
        return self._segments_of(numbers)

    def further(self, numbers: IntArray, lane_pos: Array) -> LaneSegments:
        """Return the segments of places in the same lanes as some segments (n,), most of them not far behind.

        lane_pos: m, (..., n). The result has the same shape.
        """
        numbers = np.broadcast_to(numbers, lane_pos.shape)
        while (beyond := lane_pos >= self._end[numbers]).any():
            numbers = numbers + beyond
        while (before := lane_pos < self._begin[numbers]).any():
            numbers = numbers - before
        return self._segments_of(numbers)

    def _segments_of(self, numbers: IntArray) -> LaneSegments:
        return LaneSegments(numbers, *(of.take(numbers, axis=1) for of in (self._corner, self._along, self._across)))

    def crossings(self, lane: IntArray, goal: IntArray, ends: Array, moved: Array, elapsed_s: Array) -> LaneTransitions:
        """Return how vehicles got from one lane to another, (n,) each.

        lane, goal: numbers of the lanes. ends: lane_pos before and after, m, and speed before and after, m/s, (4, n).
        moved: difference of lane_lat, m. elapsed_s: time in between.
        """
        pairs, number = np.unique(lane * len(self._lanes) + goal, return_inverse=True)
        ways = [self._way(*divmod(pair, len(self._lanes))) for pair in pairs.tolist()]
        known = np.array([way.known for way in ways], np.bool_)[number]
        sideways = np.array([way.beside >= 0 for way in ways], np.bool_)[number]
        total = np.array([way.ends[-1] if way.ends else 0.0 for way in ways])[number]
        apart = np.array([way.apart_m for way in ways])[number]
        before, after, speed, next_speed = ends
        driven = np.where(known, total + after - before, elapsed_s * (speed + next_speed) / 2.0)
        side = np.where(sideways, np.sign(-moved), 0.0)
        shift = np.where(known & ~sideways & (np.abs(moved) > SHIFT_M), moved, 0.0)
        moved = np.where(sideways, moved + side * apart, np.where(known, moved - shift, 0.0))
        return LaneTransitions(ways, number, driven, moved, side, np.where(sideways, side * apart, -shift))

    def _way(self, lane: int, goal: int) -> Way:
        if (lane, goal) not in self._ways:
            self._ways[lane, goal] = self._new_way(lane, goal)
        return self._ways[lane, goal]

    def _new_way(self, lane: int, goal: int) -> Way:
        if path := self._path(lane, goal):
            return Way(path, self._ends_of(path))
        late = [(self._path(lane, other), False) for other in self._beside(goal)]
        early = [(self._path(other, goal), True) for other in self._beside(lane)]
        ways = [(path, is_early) for path, is_early in (*late, *early) if path]
        if not ways:
            return Way((lane,), known=False)
        path, is_early = min(ways, key=lambda way: len(way[0]))
        begin, end = (lane, path[0]) if is_early else (path[-1], goal)
        half_m, other_half_m = self._lanes[begin].width_m / 2.0, self._lanes[end].width_m / 2.0
        beside = begin if is_early else end
        return Way(path, self._ends_of(path), beside, is_early, half_m, half_m + other_half_m)

    def _beside(self, lane: int) -> list[int]:
        """Return the lanes next to a lane."""
        edge, index = self._lanes[lane].edge, self._lanes[lane].index
        return [k for k in self._of_edge[edge] if abs(self._lanes[k].index - index) == 1]

    def _ends_of(self, path: tuple[int, ...]) -> tuple[float, ...]:
        """Return where each lane of a path but the last ends, m."""
        return tuple(np.cumsum([self._lanes[number].length_m for number in path[:-1]]).tolist())

    def _path(self, lane: int, goal: int) -> tuple[int, ...]:
        """Return the fewest lanes that lead from one to another, with both; none if they do not."""
        paths: list[tuple[int, ...]] = [(lane,)]
        reached = {lane}
        for _ in range(PATH_LANES):
            if goal in reached:
                break
            paths = [(*way, self._number[name]) for way in paths for name in self._lanes[way[-1]].successors]
            paths = [way for way in paths if way[-1] not in reached]
            reached |= {way[-1] for way in paths}
        return next((way for way in paths if way[-1] == goal), ())
