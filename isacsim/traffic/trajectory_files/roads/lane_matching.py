"""Which lanes vehicles are in, for files that do not say: by place and heading, along connected roads."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.checks import OFF_ROAD_M
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array

MOST_TURNED = 0.5
"""The cosine of the largest angle between a vehicle and its lane."""
BEYOND_M = 0.5
"""A vehicle may be so far beyond the end of its lane, m."""
UNCONNECTED = 25.0
"""What it costs to be on two roads in turn that are not connected. Half a lane's width off the centre of a lane costs 1
in each state."""
MOST_PASSED = 3
"""So many edges may be passed between two states: those inside junctions can be short."""


@dataclass(frozen=True)
class _Candidates:
    """For each of n states up to k edges that it may be on, ascending, -1 for none: with the nearest lane of the edge
    and the cost of being there, shape (n, k) each."""

    edge: IntArray
    lane: IntArray
    cost: Array


def match_lanes(places: LanePlaces, position: ComplexArray, heading: ComplexArray, vehicle: Int32Array) -> Int32Array:
    """Return the number of the lane of each state, shape (n,): -1 where it is on none.

    position: x + iy of the front bumper centre, m. heading: complex unit vectors. vehicle: number of the vehicle; the
    states of one vehicle follow each other, in the order of time. All of shape (n,). Where roads overlap, as inside
    junctions, a vehicle is taken to be on those that are connected.
    """
    edges = {edge: k for k, edge in enumerate(dict.fromkeys(lane.edge for lane in places.lanes))}
    found = _candidates(places, [edges[lane.edge] for lane in places.lanes], position, heading)
    if not found.edge.shape[1]:
        return np.full(len(position), -1, np.int32)
    reached = _reached(places.lanes, edges)
    changed = (found.edge[1:] != found.edge[:-1]).any(axis=1) | (vehicle[1:] != vehicle[:-1])
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    summed = np.add.reduceat(found.cost, starts, axis=0)
    chosen = np.zeros(len(starts), np.int64)
    of_run = vehicle[starts]
    for first, after in _spans(of_run):
        chosen[first:after] = _cheapest(found.edge[starts[first:after]], summed[first:after], reached)
    column = np.repeat(chosen, np.diff(np.append(starts, len(position))))
    return found.lane[np.arange(len(position)), column].astype(np.int32)


def _spans(values: Int32Array) -> list[tuple[int, int]]:
    cuts = [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1).tolist(), len(values)]
    return list(pairwise(cuts))


def _candidates(
    places: LanePlaces, edge_of: Sequence[int], position: ComplexArray, heading: ComplexArray
) -> _Candidates:  # fmt: skip
    """Return the edges that states may be on: within a metre of a lane, and not turned by more than 60 degrees."""
    states, lanes, costs = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0)]
    order = np.argsort(position.real, kind="stable")
    east = position.real[order]
    for number, lane in enumerate(places.lanes):
        reach = lane.width_m / 2.0 + OFF_ROAD_M
        low, high = lane.shape.min(axis=0) - reach, lane.shape.max(axis=0) + reach
        near = order[slice(*np.searchsorted(east, (low[0], high[0])))]
        near = near[(position.imag[near] >= low[1]) & (position.imag[near] <= high[1])]
        if not len(near):
            continue
        place = places.places(number, position[near])
        turned = (np.conj(place.heading) * heading[near]).real
        there = (np.abs(place.left) <= reach) & (np.abs(place.beyond) <= BEYOND_M) & (turned >= MOST_TURNED)
        states.append(near[there])
        lanes.append(np.full(int(there.sum()), number))
        costs.append((place.left[there] / (lane.width_m / 2.0)) ** 2 + 2.0 * (1.0 - turned[there]))
    state, lane_number, cost = np.concatenate(states), np.concatenate(lanes), np.concatenate(costs)
    edge = np.asarray(edge_of, np.int64)[lane_number]
    by_edge = np.lexsort((cost, edge, state))
    first = np.ones(len(state), bool)
    first[1:] = (np.diff(state[by_edge]) != 0) | (np.diff(edge[by_edge]) != 0)
    best = by_edge[first]
    state = state[best]
    rank = np.arange(len(state)) - np.searchsorted(state, state)
    shape = (len(position), int(rank.max()) + 1 if len(rank) else 0)
    found = _Candidates(np.full(shape, -1), np.full(shape, -1), np.zeros(shape))
    found.edge[state, rank], found.lane[state, rank], found.cost[state, rank] = (
        edge[best],
        lane_number[best],
        cost[best],
    )
    return found


def _reached(lanes: Sequence[Lane], edges: dict[str, int]) -> dict[int, set[int]]:
    """Return the edges that follow each edge, itself and those a few edges further among them."""
    edge_of = {lane.id: edges[lane.edge] for lane in lanes}
    following: dict[int, set[int]] = defaultdict(set)
    for lane in lanes:
        following[edges[lane.edge]] |= {edge_of[s] for s in lane.successors if s in edge_of}
    reached = {edge: {edge} | following[edge] for edge in edges.values()}
    for _ in range(MOST_PASSED - 1):
        reached = {edge: set().union(there, *(following[k] for k in there)) for edge, there in reached.items()}
    return reached


def _cheapest(edge: IntArray, cost: Array, reached: dict[int, set[int]]) -> list[int]:
    """Return the column of the edge that each of r runs of states is on, so that the whole costs least.

    edge, cost: of the runs of one vehicle, in order, shape (r, k).
    """
    total = np.zeros(0)
    before: list[int] = []
    came_from: list[list[int]] = []
    for row, there in enumerate(edge.tolist()):
        columns = [column for column, one in enumerate(there) if one >= 0] or [0]
        steps, totals = [0] * len(there), np.full(len(there), np.inf)
        for column in columns:
            onward = [
                float(total[k]) + (UNCONNECTED if one >= 0 and there[column] not in reached[one] else 0.0)
                for k, one in enumerate(before)
            ]
            steps[column] = int(np.argmin(onward)) if onward else 0
            totals[column] = cost[row, column] + (onward[steps[column]] if onward else 0.0)
        came_from.append(steps)
        total = totals
        # Off the road, there is no edge: it may come back anywhere.
        before = there
    chosen = [int(np.argmin(total))]
    for steps in reversed(came_from[1:]):
        chosen.append(steps[chosen[-1]])
    return chosen[::-1]
