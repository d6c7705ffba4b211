"""Who is around a vehicle: leaders, gaps along the road, and relative places, from the recording alone."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.driven_path import Path
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.route import Route

Relation = Literal["ahead", "behind", "left", "right"]


@dataclass(frozen=True)
class Leader:
    """The next vehicle ahead in the lane. gap_m: from the follower's front bumper to the leader's rear bumper, m."""

    vehicle: str
    gap_m: float


@dataclass(frozen=True)
class VehiclesInLanes:
    """The vehicles on the road at one step, sorted by lane and then by position along it.

    positions: along the lane, m. numbers: of their tracks. spans: first vehicle of each lane, and the one after its
    last.
    """

    positions: Sequence[float]
    numbers: Sequence[int]
    spans: Mapping[int, tuple[int, int]]


class Surroundings:
    """Positions of the vehicles of one recording relative to each other.

    graph: of the recording's lanes, if already at hand.
    """

    def __init__(self, recording: Recording, graph: LaneGraph | None = None) -> None:
        self.recording = recording
        self.graph = LaneGraph(recording.lanes, recording.lefthand) if graph is None else graph
        self._tracks = list(recording.tracks.values())
        self._first = np.array([track.first_step for track in self._tracks])
        lengths = np.array([len(track) for track in self._tracks], np.int64)
        self._after = self._first + lengths
        # The states of all tracks end to end; that of track k at a step is in row _row_of_step_0[k] + step.
        self._row_of_step_0 = np.cumsum(lengths) - self._after
        self._lane_of = np.concatenate([np.empty(0, np.int64), *(track.lane for track in self._tracks)])
        self._pos_of = np.concatenate([np.empty(0), *(track.lane_pos for track in self._tracks)])
        self._in_lanes = lru_cache(maxsize=2048)(self._sorted_into_lanes)
        self._path = lru_cache(maxsize=256)(self._new_path)
        self._route = lru_cache(maxsize=256)(self._new_route)

    def step(self, time: float) -> int:
        """Return the step of the recording nearest to a time (s)."""
        return round(time / self.recording.step_s)

    def present(self, time: float) -> list[Track]:
        """Return the tracks of the vehicles on the road at a time (s), without those parked beside it."""
        return [self._tracks[k] for k in self._on_road(self.step(time)).tolist()]

    def _on_road(self, step: int) -> IntArray:
        """Return the numbers of the tracks whose vehicle is on the road and not parked beside it."""
        numbers: IntArray = np.flatnonzero((self._first <= step) & (step < self._after))
        if not self.recording.parked:
            return numbers
        parked = [self.recording.is_parked(self._tracks[k].vehicle, step, step) for k in numbers.tolist()]
        return np.asarray(numbers[~np.array(parked, bool)])

    def has(self, vehicle: str, start: float, end: float) -> bool:
        """Return whether a vehicle is on the road from start to end, s, and never parked beside it."""
        track = self.recording.tracks.get(vehicle)
        if track is None:
            return False
        first, last = self.step(start), self.step(end)
        within_track = track.first_step <= first and last < track.first_step + len(track)
        return within_track and not self.recording.is_parked(vehicle, first, last)

    def leader(self, vehicle: str, time: float, within_m: float) -> Leader | None:
        """Return the next vehicle ahead in the lane and in the lanes that continue it, or None if there is none.

        Vehicles parked beside the road neither are leaders nor have one.
        time: s, at which the vehicle is on the road. within_m: maximum gap, m. Where the road forks, the search follows
        the branch that the vehicle itself drives next (`labeling.road.route`); on a road that it never drives, it has
        no leader.
        """
        track, step = self.recording.tracks[vehicle], self.step(time)
        if self.recording.is_parked(vehicle, step, step):
            return None
        row = step - track.first_step
        in_lanes = self._in_lanes(step)
        lane, pos = int(track.lane[row]), float(track.lane_pos[row])
        positions, spans = in_lanes.positions, in_lanes.spans
        route = self._route(vehicle)
        best: Leader | None = None
        ahead = [(lane, route.place(row), -pos)]
        seen = {lane}
        while ahead:
            k, place, start = ahead.pop()
            begin, after = spans.get(k, (0, 0))
            first = bisect_right(positions, -start, begin, after)
            if first < after:
                other = self._tracks[in_lanes.numbers[first]]
                gap = start + positions[first] - other.length_m
                if gap <= within_m and (best is None or gap < best.gap_m):
                    best = Leader(other.vehicle, gap)
            else:
                end = start + self.graph.lanes[k].length_m
                # Search on by the length of the longest vehicle: its front may be beyond within_m, its rear within.
                if end <= within_m + 30.0:
                    onward = [(s, at) for s, at in route.onward(k, place) if s not in seen]
                    seen.update(s for s, _ in onward)
                    ahead += [(s, at, end) for s, at in onward]
        return best

    def gaps(self, vehicle: str, other: str, times: Array) -> Array:
        """Return how far another vehicle's front bumper is ahead of this one's along the driven road, m, shape (n,).

        times: s, shape (n,). NaN where either vehicle is absent or parked, or the other one is on another road.
        """
        track, second = self.recording.tracks[vehicle], self.recording.tracks[other]
        steps = np.rint(np.asarray(times) / self.recording.step_s).astype(np.int64)
        rows, other_rows = steps - track.first_step, steps - second.first_step
        both = (rows >= 0) & (rows < len(track)) & (other_rows >= 0) & (other_rows < len(second))
        for name in {vehicle, other} & self.recording.parked.keys():
            for first, after in self.recording.parked[name]:
                both &= (steps < first) | (steps >= after)
        result = np.full(len(steps), np.nan)
        path = self._path(vehicle)
        stations = path.driver_stations(track, rows[both])
        result[both] = path.other_stations(second, other_rows[both], stations) - stations
        return result

    def relation(self, vehicle: str, other: str, time: float) -> Relation | None:
        """Return where another vehicle is at a time (s), or None if it is not on this vehicle's road.

        `ahead` and `behind` are in the vehicle's lane and the lanes that continue it; all others are `left` or
        `right`.
        """
        gap = float(self.gaps(vehicle, other, np.array([time]))[0])
        if np.isnan(gap):
            return None
        lane, other_lane = self._lane(vehicle, time), self._lane(other, time)
        upstream, downstream = (lane, other_lane) if gap >= 0 else (other_lane, lane)
        across = self._lanes_across(upstream, downstream)
        if across == 0:
            return "ahead" if gap >= 0 else "behind"
        return "left" if (across > 0) == (gap >= 0) else "right"

    def _lane(self, vehicle: str, time: float) -> int:
        track = self.recording.tracks[vehicle]
        return int(track.lane[self.step(time) - track.first_step])

    def _lanes_across(self, upstream: int, downstream: int) -> int:
        """Return how many lanes the downstream lane lies left of the continuation of the upstream one."""
        lanes, front = self.graph.lanes, {upstream}
        for _ in range(20):
            beside = [k for k in front if lanes[k].edge == lanes[downstream].edge]
            if beside:
                return min((self.graph.levels(k, downstream) for k in beside), key=abs)
            front = {s for k in front for s in self.graph.successors[k]}
        return 1

    def _new_path(self, vehicle: str) -> Path:
        return Path(self.recording.tracks[vehicle], self.graph)

    def _new_route(self, vehicle: str) -> Route:
        return Route(self.recording.tracks[vehicle], self.graph)

    def _sorted_into_lanes(self, step: int) -> VehiclesInLanes:
        numbers = self._on_road(step)
        rows = self._row_of_step_0[numbers] + step
        lanes, positions = self._lane_of[rows], self._pos_of[rows]
        order = np.lexsort((positions, lanes))
        lanes = lanes[order]
        starts = np.flatnonzero(np.diff(lanes, prepend=-1))
        ends = [*starts[1:].tolist(), len(lanes)]
        spans = dict(zip(lanes[starts].tolist(), zip(starts.tolist(), ends, strict=True), strict=True))
        return VehiclesInLanes(positions[order].tolist(), numbers[order].tolist(), spans)
