"""The way that a vehicle still has before it: the edges that it drives later, and the lanes that lead there."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.labeling.road.lane_graph import MAX_SKIPPED, LaneGraph

PASSED_M = 1.0
"""A vehicle may pass a lane that is shorter than this between two rows of its track, m."""


def segments(track: Track) -> list[tuple[int, int, int]]:
    """Return the stretches of a track on one lane each: first row, row after the last, lane."""
    cuts = [0, *(np.flatnonzero(track.lane[1:] != track.lane[:-1]) + 1).tolist(), len(track)]
    return [(a, b, int(track.lane[a])) for a, b in pairwise(cuts) if b > a]


def after(driven: Sequence[str], onward: Sequence[str]) -> tuple[str, ...]:
    """Return the edges that a vehicle had still to drive, without those that it has driven.

    onward: as in `isacsim.traffic.recordings.recording.Track`; the last edge that was driven, or earlier ones, may be
    among them.
    """
    last = next((edge for edge in reversed(driven) if not edge.startswith(":")), None)
    return tuple(onward[onward.index(last) + 1 :]) if last in onward else tuple(onward)


class Route:
    """The edges that a vehicle drives, in order, and after its track those that it had still to drive.

    driven: number of the edges that it drives within its track.
    Where a road forks, the way on is the branch that the vehicle drives next. Beyond the end of a track, it is the one
    that the vehicle had still to drive; where that is not known, the way leads on as long as the road does not fork.
    """

    def __init__(self, track: Track, graph: LaneGraph) -> None:
        self._graph = graph
        self._starts: list[int] = []
        self._edges: list[str] = []
        for start, _, lane in segments(track):
            if not self._edges or graph.lanes[lane].edge != self._edges[-1]:
                self._edges.append(graph.lanes[lane].edge)
                self._starts.append(start)
        self.driven = len(self._edges)
        self._open = track.onward is None
        self._edges += after(self._edges, track.onward or ())
        self._ends = [place for place, edge in enumerate(self._edges) if not edge.startswith(":")]
        self._places: dict[str, list[int]] = {}
        for place, edge in enumerate(self._edges):
            self._places.setdefault(edge, []).append(place)
        self.onward = lru_cache(maxsize=None)(self._onward)

    def place(self, row: int) -> int:
        """Return the place on the route, a number of its edges, of the vehicle at a row of its track."""
        return bisect_right(self._starts, row) - 1

    def _onward(self, lane: int, place: int) -> tuple[tuple[int, int], ...]:
        """Return the lanes that continue a lane on the route, each with its place there.

        place: that of the lane. None if the vehicle drives none of them.
        """
        successors = self._graph.successors[lane]
        reached = [(s, self._next(s, place)) for s in successors]
        within = self._ends[k] if (k := bisect_right(self._ends, place)) < len(self._ends) else place
        first = min((at for _, at in reached if at is not None and at <= within), default=None)
        if first is not None:
            return tuple((s, self._place_of(s, place, at)) for s, at in reached if at == first)
        if not self._open or place < self.driven - 1:
            return ()
        beside = self._graph.on_edge[self._graph.lanes[lane].edge]
        ends = {edge for k in beside for s in self._graph.successors[k] for edge in self._leads_to(s)}
        return tuple((s, place) for s in successors) if len(ends) == 1 else ()

    def _next(self, lane: int, place: int) -> int | None:
        """Return the next place after one that a lane is on or leads to through a junction; None if it does not."""
        return min((at for edge in self._reach(lane) if (at := self._later(edge, place)) is not None), default=None)

    def _place_of(self, lane: int, place: int, reached: int) -> int:
        """Return the place of a lane that leads to another one: its own, or that of the lane before it."""
        return reached if self._later(self._graph.lanes[lane].edge, place) == reached else place

    def _later(self, edge: str, place: int) -> int | None:
        """Return the first place of an edge after another one."""
        places = self._places.get(edge, [])
        k = bisect_right(places, place)
        return places[k] if k < len(places) else None

    def _reach(self, lane: int) -> list[str]:
        """Return the edge of a lane, and, if it lies in a junction, those to which it leads through the junction.

        A vehicle may pass a very short lane between two rows of its track, as if it were part of the junction.
        """
        lanes, edges, front = self._graph.lanes, list[str](), {lane}
        for _ in range(MAX_SKIPPED):
            edges += [lanes[k].edge for k in front]
            passed = [k for k in front if lanes[k].edge.startswith(":") or lanes[k].length_m < PASSED_M]
            front = {s for k in passed for s in self._graph.successors[k]}
        return edges

    def _leads_to(self, lane: int) -> set[str]:
        """Return the edges outside of junctions that a lane is on or leads to."""
        return {edge for edge in self._reach(lane) if not edge.startswith(":")}
