"""States at every step, rebuilt from states that were taken less often.

A driver of SUMO chooses an acceleration at an action step, every 0.1 s by default, and keeps it until the next one.
Within its lane, a vehicle therefore moves on a parabola from one action step to the next. Where there is one action
step, at a known time, between two samples, their speeds and positions give the accelerations before and after it, and
so the speed and the position at every step in between, but for rounding. Lateral motion has no such law and is
interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from isacsim.arrays import Array, BoolArray, IntArray
from isacsim.scenarios.lane import Lane

X, Y, SPEED, LANE_POS, LANE_LAT, LANE = range(6)
"""The rows of a block of states."""
ROWS = 6
JUMP_M = 0.3
"""No vehicle drives this far aside from one sample to the next, m. SUMO moves some that far at once."""
CLOSE = 4
"""Steps within which a sample of a commanded vehicle is followed by another one."""


@dataclass(frozen=True)
class Samples:
    """The states of a vehicle at some steps.

    steps: ascending, (k,). states: x, y, speed, lane_pos, lane_lat and the number of the lane, (6, k). turn: after how
    many steps the driver decides next, (k,).
    """

    steps: IntArray
    states: Array
    turn: Array

    @classmethod
    def of(cls, steps: IntArray, states: Array, commanded: BoolArray, acted: int, action_steps: int) -> Self:
        """Return samples of a driver who decided at one step, and decides again after every so many steps.

        commanded: whether the vehicle is commanded after each sample, (k,). A command changes the acceleration all the
        time: it is taken to change halfway.
        """
        gaps = np.diff(steps, append=steps[-1] + 1)
        # What SUMO wrote right after a sample of a commanded vehicle is commanded as well.
        commanded = commanded | np.append(False, commanded[:-1] & (gaps[:-1] < CLOSE))
        return cls(steps, states, np.where(commanded, gaps / 2.0, (acted - steps) % action_steps))


def at_every_step(samples: Samples, last_step: int, road: Road, step_s: float) -> Array:
    """Return the states of a vehicle at every step from its first sample to a last step, shape (6, n).

    samples: where they are more than one step apart, the driver decides at most once in between. last_step: of the last
    state, not before the last sample. road: of the lanes that the samples give as numbers.
    Returns x, y, speed, lane_pos, lane_lat and the number of the lane. Those of the samples are the samples.
    """
    first_row = samples.steps - samples.steps[0]
    gaps = np.diff(samples.steps, append=last_step + 1)
    taken = np.ascontiguousarray(samples.states)
    lane = taken[LANE].astype(np.int64)
    places = road.places(lane, taken[LANE_POS])
    aside = taken[: Y + 1] - places.points(taken[LANE_POS], taken[LANE_LAT])
    # A vehicle leaves the road at a sample (`SampledLog`), and is on it until then.
    drift = _without_jumps(np.diff(aside, axis=1, append=aside[:, -1:]))
    block = np.empty((ROWS, int(gaps.sum())))
    block[:, first_row] = taken
    crossings = {
        k: road.crossing(int(lane[k]), int(lane[k + 1]), taken[:, k], taken[:, k + 1], float(gaps[k]) * step_s)
        for k in _changes(lane, gaps)
    }
    driven, moved = np.diff(taken[LANE_POS]), np.diff(taken[LANE_LAT], append=taken[LANE_LAT, -1])
    for k, crossing in crossings.items():
        driven[k], moved[k] = crossing.driven_m, crossing.moved_m
    along = _Along.of(gaps, samples.turn, taken, driven, step_s)
    sideways = _slopes(gaps, moved)
    for gap in np.unique(gaps[gaps > 1]).tolist():
        of_gap = np.flatnonzero(gaps == gap)
        elapsed = np.arange(1.0, gap)
        speed, lane_pos = along.after(elapsed, of_gap)
        lane_lat = taken[LANE_LAT, of_gap, None] + _cubic(sideways[:, of_gap, None], elapsed / gap)
        # Nobody knows when a jump was; halfway is at most half the time wrong.
        later = elapsed >= gap / 2.0
        lane_lat += (moved - sideways[0])[of_gap, None] * later
        lanes = np.broadcast_to(taken[LANE, of_gap, None], lane_pos.shape)
        crossed = [number for number, sample in enumerate(of_gap.tolist()) if sample in crossings]
        if crossed:
            lanes = lanes.copy()
            for number in crossed:
                lanes[number], lane_pos[number], lane_lat[number] = crossings[int(of_gap[number])].places(
                    lane_pos[number], lane_lat[number]
                )
        points = road.follow(places, of_gap, lanes, lane_pos, lane_lat)
        points += aside[:, of_gap, None] + drift[:, of_gap, None] * (elapsed / gap)
        rows = first_row[of_gap, None] + np.arange(1, gap)
        for row, values in zip(block, (*points, speed, lane_pos, lane_lat, lanes), strict=True):
            row[rows] = values
    return block


def _changes(lane: IntArray, gaps: IntArray) -> list[int]:
    """Return the samples after which the lane changes some steps later."""
    changes: list[int] = np.flatnonzero((lane[1:] != lane[:-1]) & (gaps[:-1] > 1)).tolist()
    return changes


def _without_jumps(changes: Array) -> Array:
    """Return changes from one sample to the next, m, with 0 for jumps."""
    return np.asarray(np.where(np.abs(changes) > JUMP_M, 0.0, changes))


@dataclass(frozen=True)
class _Along:
    """How a vehicle moves along its lane after each sample, in steps: two accelerations, one after the other.

    speed: m per step. lane_pos: m. before, then: acceleration until the driver decides, and from then on, m per step
    squared. turn: steps until then. moving: steps until the vehicle stops, infinite if it does not. Shape (k,) each.
    """

    speed: Array
    lane_pos: Array
    before: Array
    then: Array
    turn: Array
    moving: Array
    step_s: float

    @classmethod
    def of(cls, gaps: IntArray, turn: Array, taken: Array, driven: Array, step_s: float) -> Self:
        """Find the accelerations. driven: m from each sample to the next, (k - 1,).

        Over n = i + j steps with the acceleration a in the first i and b in the other j, a vehicle at speed v moves on
        by dp, and its speed changes by dv:

            dp = v n + a (i^2 / 2 + i j) + b j^2 / 2,    dv = a i + b j,

        so that a = 2 (dp - v n - dv j / 2) / (n i). After the last sample, a vehicle keeps its acceleration.
        """
        speed, lane_pos = taken[SPEED] * step_s, taken[LANE_POS]
        n = gaps[:-1]
        i = np.minimum(turn[:-1], n)
        dv, dp, v = np.diff(speed), driven, speed[:-1]
        # A decision at the sample itself leaves one acceleration.
        a = np.where(i > 0, 2.0 * (dp - v * n - dv * (n - i) / 2.0) / (n * np.where(i > 0, i, 1)), dv / n)
        b = np.where(i < n, (dv - a * i) / np.where(i < n, n - i, 1), a)
        moving = np.full(len(gaps), np.inf)
        stops = np.flatnonzero((speed[1:] == 0.0) & (v > 0.0) & (dp > 0.0) & (n > 1))
        moving[stops] = 2.0 * dp[stops] / v[stops]
        a[stops] = b[stops] = -v[stops] / moving[stops]
        last = float(b[-1]) if len(b) and speed[-1] > 0.0 else 0.0
        if last < 0.0:
            moving[-1] = -speed[-1] / last
        return cls(speed, lane_pos, np.append(a, last), np.append(b, last), turn, moving, step_s)

    def after(self, elapsed: Array, k: IntArray) -> tuple[Array, Array]:
        """Return speed, m/s, and position, m, some steps (t,) after each of some samples k (m,), shape (m, t) each."""
        steps = np.minimum(elapsed, self.moving[k, None])
        i = np.minimum(steps, self.turn[k, None])
        j = steps - i
        gained = self.before[k, None] * i
        middle = self.speed[k, None] + gained
        later = self.then[k, None] * j
        lane_pos = self.lane_pos[k, None] + (self.speed[k, None] + 0.5 * gained) * i + (middle + 0.5 * later) * j
        return np.maximum(middle + later, 0.0) / self.step_s, lane_pos


def _slopes(gaps: IntArray, moved: Array) -> Array:
    """Return of lateral positions after each sample: their change, and their slopes at its ends in shares of its time.

    moved: m aside from each sample to the next, (k,). Returns shape (3, k). The slope at a sample is that of the
    parabola through it and its neighbours. Across a jump there is neither.
    """
    change = _without_jumps(moved)
    rate = change / gaps
    before, gap_before = np.append(rate[:1], rate[:-1]), np.append(gaps[:1], gaps[:-1])
    slope = (before * gaps + rate * gap_before) / (gaps + gap_before)
    slope[-1] = before[-1]
    jumps = moved != change
    slope[jumps | np.append(False, jumps[:-1]) | (change == 0.0) & (before == 0.0)] = 0.0
    at_end = np.append(slope[1:], 0.0)
    still = change == 0.0
    return np.stack([change, np.where(still, 0.0, slope * gaps), np.where(still, 0.0, at_end * gaps)])


def _cubic(slopes: Array, share: Array) -> Array:
    """Return the change of a cubic after shares of its time. slopes: as `_slopes` returns them."""
    change, at_start, at_end = slopes
    bend = at_start + at_end - 2.0 * change
    return np.asarray(share * (at_start + share * (3.0 * change - 2.0 * at_start - at_end + share * bend)))


SHIFT_M = 0.2
"""No vehicle drives this far aside while it passes the end of a lane, m; the lanes are offset by that much."""
PATH_LANES = 8
"""A vehicle drives through fewer lanes than this from one sample to the next."""


@dataclass(frozen=True)
class Places:
    """Straight segments of lanes, one for each of n places: where lane_pos and lane_lat lead in the plane.

    numbers: of the segments, (n,). corner: point of lane_pos 0, had the lane only this segment, (2, n), m.
    along, across: of one metre of lane_pos and of lane_lat, (2, n).
    """

    lane: IntArray
    numbers: IntArray
    corner: Array
    along: Array
    across: Array

    def points(self, lane_pos: Array, lane_lat: Array) -> Array:
        """Return points of the plane, m, (2, n)."""
        return np.asarray(self.corner + self.along * lane_pos + self.across * lane_lat)


@dataclass(frozen=True)
class Crossing:
    """How a vehicle comes from one lane into another between two samples: by driving on, sideways, or both.

    lanes: that lead on from one to the next. ends: where each of them but the last ends, m from the beginning of the
    first. driven_m, moved_m: distances from sample to sample, along and to the left. side: +1 to the left, -1 to the
    right, 0 if the vehicle only drives on. half_m: from the middle of its lane to the marking. apart_m: to the left,
    from the middle of a lane to that of the next one, where it does not simply go on. beside: the other lane.
    early: whether the vehicle comes from that lane; otherwise it ends there.
    """

    lanes: tuple[int, ...]
    ends: tuple[float, ...]
    driven_m: float
    moved_m: float
    side: float = 0.0
    half_m: float = np.inf
    apart_m: float = 0.0
    beside: int = -1
    early: bool = False

    def places(self, lane_pos: Array, lane_lat: Array) -> tuple[Array, Array, Array]:
        """Return lane, lane_pos and lane_lat of places, (t,) each.

        lane_pos: from the beginning of the first lane. lane_lat: from the middle of the lane that the vehicle is in at
        first.
        """
        passed = np.searchsorted(self.ends, lane_pos, side="left")
        lane = np.array(self.lanes, float)[passed]
        within = lane_pos - np.append(0.0, self.ends)[passed]
        if not self.side:
            return lane, within, lane_lat - np.where(passed == len(self.ends), self.apart_m, 0.0)
        across = self.side * lane_lat > self.half_m
        across = across | (passed > 0) if self.early else across & (passed == len(self.ends))
        lane = np.where(across != self.early, self.beside, lane)
        return lane, within, lane_lat - np.where(across, self.apart_m, 0.0)


class Road:
    """The centre lines of lanes, as SUMO reads positions from them."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        """Take the segments of all lanes."""
        self._lanes = lanes
        self._number = {lane.id: k for k, lane in enumerate(lanes)}
        self._paths: dict[tuple[int, int], tuple[int, ...]] = {}
        self._of_edge: dict[str, list[int]] = {}
        for k, lane in enumerate(lanes):
            self._of_edge.setdefault(lane.edge, []).append(k)
        ends, corners, along, across, self._first = [], [], [], [], [0]
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
            self._first.append(self._first[-1] + len(segment_ends))
        self._ends = ends
        self._corner, self._along, self._across = (
            np.stack([values.real, values.imag]) for values in map(np.concatenate, (corners, along, across))
        )

    def places(self, lane: IntArray, lane_pos: Array) -> Places:
        """Return the segments that places are in. lane: numbers of lanes, (n,). lane_pos: m, (n,)."""
        numbers = np.empty(len(lane), np.int64)
        starts = np.concatenate([[0], np.flatnonzero(lane[1:] != lane[:-1]) + 1, [len(lane)]])
        for start, stop in pairwise(starts.tolist()):
            number = int(lane[start])
            segment = np.searchsorted(self._ends[number][:-1], lane_pos[start:stop], side="right")
            numbers[start:stop] = self._first[number] + segment
        return Places(lane, numbers, self._corner[:, numbers], self._along[:, numbers], self._across[:, numbers])

    def follow(self, places: Places, k: IntArray, lanes: Array, lane_pos: Array, lane_lat: Array) -> Array:
        """Return the points of vehicles that drive on from some places, m, (2, m, t).

        k: which of the places, (m,). lanes, lane_pos, lane_lat: where they are at t instants, m, (m, t).
        """
        points = places.corner[:, k, None] + places.along[:, k, None] * lane_pos + places.across[:, k, None] * lane_lat
        # Two samples in one segment have all between them in it.
        beyond = np.append(places.numbers[1:] != places.numbers[:-1], True)
        turns = beyond[k]
        if turns.any():
            lane, along, aside = lanes[turns].astype(np.int64).ravel(), lane_pos[turns].ravel(), lane_lat[turns].ravel()
            points[:, turns] = self.places(lane, along).points(along, aside).reshape(2, -1, lane_pos.shape[1])
        return np.asarray(points)

    def crossing(self, lane: int, next_lane: int, state: Array, next_state: Array, elapsed_s: float) -> Crossing:
        """Return how a vehicle got from one lane to another.

        state, next_state: before and after, (6,). elapsed_s: time in between.
        """
        moved = float(next_state[LANE_LAT] - state[LANE_LAT])
        late = [(self._path(lane, other), other, False) for other in self._beside(next_lane)]
        early = [(self._path(other, next_lane), other, True) for other in self._beside(lane)]
        ways = [(path, other, early) for path, other, early in (*late, *early) if path]
        if path := self._path(lane, next_lane):
            ends = self._ends_of(path)
            shift = moved if abs(moved) > SHIFT_M else 0.0
            driven = ends[-1] + next_state[LANE_POS] - state[LANE_POS]
            return Crossing(path, ends, driven, moved - shift, apart_m=-shift)
        if not ways:
            # No way leads there. The vehicle stays in its lane until the next sample.
            driven = elapsed_s * (state[SPEED] + next_state[SPEED]) / 2.0
            return Crossing((lane,), (), driven, 0.0)
        path, _, early_way = min(ways, key=lambda way: len(way[0]))
        begin, end = (lane, path[0]) if early_way else (path[-1], next_lane)
        first, second = self._lanes[begin], self._lanes[end]
        half = first.width_m / 2.0
        apart, side = (first.width_m + second.width_m) / 2.0, float(np.sign(-moved))
        ends = self._ends_of(path)
        driven = (ends[-1] if ends else 0.0) + next_state[LANE_POS] - state[LANE_POS]
        beside = begin if early_way else end
        return Crossing(path, ends, driven, moved + side * apart, side, half, side * apart, beside, early_way)

    def _beside(self, lane: int) -> list[int]:
        """Return the lanes next to a lane."""
        edge, index = self._lanes[lane].edge, self._lanes[lane].index
        return [k for k in self._of_edge[edge] if abs(self._lanes[k].index - index) == 1]

    def _ends_of(self, path: tuple[int, ...]) -> tuple[float, ...]:
        """Return where each lane of a path but the last ends, m."""
        return tuple(np.cumsum([self._lanes[number].length_m for number in path[:-1]]).tolist())

    def _path(self, lane: int, goal: int) -> tuple[int, ...]:
        """Return the fewest lanes that lead from one to another, with both; none if they do not."""
        if (lane, goal) not in self._paths:
            paths: list[tuple[int, ...]] = [(lane,)]
            reached = {lane}
            for _ in range(PATH_LANES):
                if goal in reached:
                    break
                paths = [(*way, self._number[name]) for way in paths for name in self._lanes[way[-1]].successors]
                paths = [way for way in paths if way[-1] not in reached]
                reached |= {way[-1] for way in paths}
            self._paths[lane, goal] = next((way for way in paths if way[-1] == goal), ())
        return self._paths[lane, goal]
