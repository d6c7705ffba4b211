"""Positions along the road that a vehicle drives: its own, and those of other vehicles on that road."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.route import Route, segments

BEYOND_M = 300.0
"""How far a path extends before the first edge of a track and after its last one, m."""


class Path:
    """The edges that a vehicle drives, in order, with stations: distances from the start of the first edge, m.

    A lane is on the path if its edge is driven, if it joins two driven edges, or if it leads up to the first one or
    continues the last one on the vehicle's route within `BEYOND_M`. Lanes that leave the path or merge into it are
    other roads.
    """

    def __init__(self, track: Track, graph: LaneGraph) -> None:
        self._graph = graph
        self._route = Route(track, graph)
        self._bases: list[float] = []
        self._starts: list[int] = []
        self._edges: list[str] = []
        self._lanes: list[int] = []
        for start, _, lane in segments(track):
            edge = graph.lanes[lane].edge
            if not self._edges or edge != self._edges[-1]:
                self._enter(edge, lane)
                self._starts.append(track.first_step + start)
        self._stations = self._all_stations()

    def _enter(self, edge: str, lane: int) -> None:
        base = 0.0
        if self._edges:
            skipped = self._graph.link(self._lanes[-1], lane)
            base = self._bases[-1] + self._graph.lanes[self._lanes[-1]].length_m + (skipped or 0.0)
        self._edges.append(edge)
        self._lanes.append(lane)
        self._bases.append(base)

    def _all_stations(self) -> dict[int, list[tuple[float, float]]]:
        """Return for each lane on the path, for each visit: the station of its start, m, and the scale along it."""
        graph, stations = self._graph, defaultdict(list)
        for edge, lane, base in zip(self._edges, self._lanes, self._bases, strict=True):
            for k in graph.on_edge[edge]:
                stations[k].append((base, graph.lanes[lane].length_m / graph.lanes[k].length_m))
        driven = set(self._edges)
        for j in range(len(self._edges) - 1):
            self._add_joints(stations, driven, j)
        self._extend_ahead(stations, driven)
        self._extend_behind(stations, driven)
        return dict(stations)

    def _add_joints(self, stations: dict[int, list[tuple[float, float]]], driven: set[str], j: int) -> None:
        """Add the junction lanes beside the one that is driven between edges j and j + 1."""
        graph = self._graph
        start = self._bases[j] + graph.lanes[self._lanes[j]].length_m
        onward = set(self._edges[j + 1 : j + 4])
        for k in graph.on_edge[self._edges[j]]:
            for s in graph.successors[k]:
                if graph.lanes[s].edge not in driven:
                    targets = {graph.lanes[t].edge for t in graph.successors[s]} & onward
                    if targets:
                        length = self._bases[self._edges.index(min(targets), j + 1)] - start
                        scale = length / graph.lanes[s].length_m if length > 0 else 1.0
                        stations[s].append((start, scale))

    def _extend_ahead(self, stations: dict[int, list[tuple[float, float]]], driven: set[str]) -> None:
        """Add the lanes that continue the last edge on the vehicle's route."""
        graph, end = self._graph, self._bases[-1] + self._graph.lanes[self._lanes[-1]].length_m
        front = dict.fromkeys(graph.on_edge[self._edges[-1]], (self._route.driven - 1, end))
        seen = set(front)
        while front:
            onward: dict[int, tuple[int, float]] = {}
            for k, (place, start) in front.items():
                for n, at in self._route.onward(k, place):
                    if n in seen or graph.lanes[n].edge in driven:
                        continue
                    seen.add(n)
                    stations[n].append((start, 1.0))
                    if start - end < BEYOND_M:
                        onward[n] = at, start + graph.lanes[n].length_m
            front = onward

    def _extend_behind(self, stations: dict[int, list[tuple[float, float]]], driven: set[str]) -> None:
        """Add the lanes that lead up to the first edge."""
        graph, base = self._graph, self._bases[0]
        front = dict.fromkeys(graph.on_edge[self._edges[0]], base)
        seen = set(front)
        while front:
            onward: dict[int, float] = {}
            for k, station in front.items():
                for n in graph.predecessors[k]:
                    if n in seen or graph.lanes[n].edge in driven:
                        continue
                    seen.add(n)
                    start = station - graph.lanes[n].length_m
                    stations[n].append((start, 1.0))
                    if base - start < BEYOND_M:
                        onward[n] = start
            front = onward

    def driver_stations(self, track: Track, rows: IntArray) -> Array:
        """Return the stations of the vehicle whose path this is, at rows (n,) of its track, m, shape (n,)."""
        visit = np.searchsorted(self._starts, track.first_step + rows, side="right") - 1
        return np.asarray(np.array(self._bases)[visit] + track.lane_pos[rows])

    def other_stations(self, track: Track, rows: IntArray, near: Array) -> Array:
        """Return the stations of another vehicle at rows (n,) of its track, m, shape (n,); NaN where off the path.

        near: stations of the path's driver at the same times, m, shape (n,). On an edge that is driven several times,
        the visit that puts the two vehicles closest together counts.
        """
        result = np.full(len(rows), np.nan)
        lanes = track.lane[rows]
        for lane in np.unique(lanes):
            mask = lanes == lane
            for base, scale in self._stations.get(int(lane), ()):
                station = base + scale * track.lane_pos[rows[mask]]
                closer = ~(np.abs(result[mask] - near[mask]) <= np.abs(station - near[mask]))
                result[mask] = np.where(closer, station, result[mask])
        return result
