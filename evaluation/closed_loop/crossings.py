"""Post-encroachment times where paths cross inside a junction, from a recording alone, for all vehicles at once.

Two lanes inside a junction that come from different edges, lead into different lanes and cross have a conflict point.
The post-encroachment time is from the instant when the rear of one vehicle has passed that point to the instant when
the front of the next one on the other lane gets there. Paths that part or merge do not cross: where they merge,
vehicles follow each other.

Source: Allen, Shin and Cooper 1978.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.safety import LONGEST_PET_S, Encroachments, arrival
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.road.lane_graph import LaneGraph

END_M = 1.0
"""Lanes that meet nearer than this to the ends of both part or merge there; they do not cross, m."""


@dataclass(frozen=True)
class LaneCrossing:
    """Where the centre lines of two lanes cross. lanes: their numbers in the recording. places: m along each."""

    lanes: tuple[int, int]
    places: tuple[float, float]


@dataclass(frozen=True)
class _Pass:
    """A vehicle passes a conflict point on a lane: its front arrives, its rear has left, s."""

    arrives_s: float
    leaves_s: float
    vehicle: str
    lane: int


def crossings(recording: Recording) -> Encroachments:
    """Return the passages of crossing paths one after the other, by time, within `LONGEST_PET_S` of each other.

    entering: the vehicle that passes first. behind: the next one on the other lane. time_s: when the first arrives.
    """
    rows: list[tuple[float, str, str, float]] = []
    first_rows = _first_rows(recording)
    for crossing in conflict_points(recording.lanes):
        passes = [
            one
            for lane, place in zip(crossing.lanes, crossing.places, strict=True)
            for one in _passes(recording, first_rows.get(lane, ()), lane, place)
        ]
        passes.sort(key=lambda one: (one.arrives_s, one.vehicle))
        for one, next_one in pairwise(passes):
            pet_s = next_one.arrives_s - one.leaves_s
            if one.lane != next_one.lane and pet_s <= LONGEST_PET_S:
                rows.append((one.arrives_s, one.vehicle, next_one.vehicle, pet_s))
    return Encroachments.of(sorted(rows), crossing=True)


def conflict_points(lanes: Sequence[Lane]) -> list[LaneCrossing]:
    """Return where lanes of the same junction cross."""
    inside: dict[str, list[int]] = defaultdict(list)
    for number, lane in enumerate(lanes):
        if lane.edge.startswith(":"):
            inside[lane.edge.rpartition("_")[0]].append(number)
    graph, points = LaneGraph(lanes), []
    for numbers in inside.values():
        origins = {k: {lanes[out].edge for out in _outside(k, lanes, graph.predecessors)} for k in numbers}
        goals = {k: _outside(k, lanes, graph.successors) for k in numbers}
        for first, second in combinations(numbers, 2):
            if origins[first].isdisjoint(origins[second]) and goals[first].isdisjoint(goals[second]):
                points += [
                    LaneCrossing((first, second), places) for places in _intersections(lanes[first], lanes[second])
                ]
    return points


def _outside(lane: int, lanes: Sequence[Lane], onward: Sequence[Iterable[int]]) -> set[int]:
    """Return the lanes outside the junction to which a lane inside it leads, or from which it comes."""
    found, seen, open_ = set(), {lane}, [lane]
    while open_:
        for k in onward[open_.pop()]:
            if not lanes[k].edge.startswith(":"):
                found.add(k)
            elif k not in seen:
                seen.add(k)
                open_.append(k)
    return found


def _intersections(one: Lane, other: Lane) -> Iterator[tuple[float, float]]:
    """Yield where two centre lines cross, m along each."""
    shapes = [lane.shape @ np.array([1.0, 1.0j]) for lane in (one, other)]
    lengths = [np.abs(np.diff(shape)) for shape in shapes]
    if not all(part.sum() > 0 for part in lengths):
        return
    starts = [np.concatenate([[0.0], np.cumsum(part)]) for part in lengths]
    (a, b), (u, v) = (shape[:-1] for shape in shapes), (np.diff(shape) for shape in shapes)
    apart = b[None, :] - a[:, None]
    turn = np.imag(np.conj(u)[:, None] * v[None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        along_u = np.imag(np.conj(apart) * v[None, :]) / turn
        along_v = np.imag(np.conj(apart) * u[:, None]) / turn
    crosses = (turn != 0) & (along_u >= 0) & (along_u < 1) & (along_v >= 0) & (along_v < 1)
    for row, column in np.argwhere(crosses).tolist():
        places = (
            float(starts[0][row] + along_u[row, column] * lengths[0][row]),
            float(starts[1][column] + along_v[row, column] * lengths[1][column]),
        )
        to_end = [part.sum() - place for part, place in zip(lengths, places, strict=True)]
        if max(places) < END_M or max(to_end) < END_M:
            continue
        # SUMO stretches the shape of a lane to its length.
        yield (
            places[0] * one.length_m / float(lengths[0].sum()),
            places[1] * other.length_m / float(lengths[1].sum()),
        )


def _first_rows(recording: Recording) -> dict[int, list[tuple[str, int]]]:
    """Return the vehicles that enter each lane inside a junction, with the row of their track where they do."""
    inside = np.array([lane.edge.startswith(":") for lane in recording.lanes], dtype=bool)
    rows: dict[int, list[tuple[str, int]]] = defaultdict(list)
    for track in recording.tracks.values():
        lane = np.asarray(track.lane)
        begins = np.flatnonzero(np.concatenate([[True], lane[1:] != lane[:-1]]) & inside[lane])
        for row in begins.tolist():
            rows[int(lane[row])].append((track.vehicle, row))
    return rows


def _passes(recording: Recording, entered: Sequence[tuple[str, int]], lane: int, place_m: float) -> Iterator[_Pass]:
    """Yield the vehicles that pass a place on a lane."""
    for vehicle, row in entered:
        track = recording.tracks[vehicle]
        if float(track.lane_pos[row]) > place_m:
            continue
        arrives, leaves = (
            arrival(track, row, lane, place_m + behind_m, recording.step_s, stays=False)
            for behind_m in (0.0, track.length_m)
        )
        if arrives is not None and leaves is not None:
            yield _Pass(arrives, leaves, vehicle, lane)


def joined(*parts: Encroachments) -> Encroachments:
    """Return several lists of encroachments as one."""
    names = ("time_s", "pet_s", "crossing")
    columns: dict[str, Array] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Encroachments(
        entering=tuple(name for part in parts for name in part.entering),
        behind=tuple(name for part in parts for name in part.behind),
        time_s=columns["time_s"],
        pet_s=columns["pet_s"],
        crossing=columns["crossing"].astype(bool),
    )
