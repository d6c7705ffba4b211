"""Safety and efficiency of traffic, from its recording alone, for all vehicles at once.

Surrogates of danger are measured between a vehicle and the next one ahead in its lane (`Surroundings.leader`), with gap
g and speeds v and v_l:

    time to collision                         TTC  = g / (v - v_l)         while v > v_l
    deceleration rate to avoid the crash      DRAC = (v - v_l)^2 / (2 g)   while v > v_l

and, where a vehicle enters a lane ahead of another, the post-encroachment time: from the instant when its rear has
passed the place of entry to the instant when the front of the vehicle behind gets there. Paths that cross are in
`evaluation.closed_loop.crossings`. A vehicle alongside in the
same lane (g <= 0), as in the middle of a lane change, has no gap and none of these.

Sources: Hayward 1972 (TTC); Almqvist, Hydén and Risser 1991 (DRAC); Allen, Shin and Cooper 1978 (PET).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.surroundings import Surroundings

EVERY_S = 0.1
"""Interval at which states are measured, s."""
LEADER_M = 150.0
"""Distance within which a vehicle has a leader, m."""
LONGEST_PET_S = 5.0
"""A vehicle that gets to a place later than this after another one has left it is no encroachment, s."""
SMOOTHING_S = 0.15
"""Standard deviation of the kernel behind decelerations, s: raw speeds have steps in their acceleration."""


@dataclass(frozen=True)
class VehicleMotions:
    """What each vehicle did at each instant, n rows, vehicle by vehicle in order of time.

    names: of the vehicles. vehicle: number in `names`, (n,). time_s: s. x, y: m. speed: m/s. acceleration: along the
    lane, conditioned, m/s2. ttc_s: time to collision, infinite where the gap does not close. drac_mps2: 0 there.
    every_s: time for which a row stands, s.
    """

    names: tuple[str, ...]
    every_s: float
    vehicle: IntArray
    time_s: Array
    x: Array
    y: Array
    speed: Array
    acceleration: Array
    ttc_s: Array
    drac_mps2: Array


@dataclass(frozen=True)
class Encroachments:
    """Places that one vehicle passes soon after another one, (m,) each: entries into a lane, and paths that cross.

    entering, behind: the two vehicles, by name: the one that enters a lane or passes first, and the next one. time_s:
    of the entry, or of the first passage. pet_s: post-encroachment time; negative where the next vehicle reaches the
    place before the other one's rear has left it. crossing: whether paths cross (`evaluation.closed_loop.crossings`).
    """

    entering: tuple[str, ...]
    behind: tuple[str, ...]
    time_s: Array
    pet_s: Array
    crossing: BoolArray

    @classmethod
    def of(cls, rows: Sequence[tuple[float, str, str, float]], crossing: bool) -> Encroachments:
        """Return rows of (time, entering, behind, post-encroachment time), all of one kind."""
        return cls(
            tuple(row[1] for row in rows),
            tuple(row[2] for row in rows),
            np.array([row[0] for row in rows], dtype=np.float64),
            np.array([row[3] for row in rows], dtype=np.float64),
            np.full(len(rows), crossing),
        )


def time_to_collision_s(gap_m: Array, closing_mps: Array) -> Array:
    """Return the time until gaps close at a constant closing speed, s; infinite where they do not, (n,)."""
    closes = (gap_m > 0.0) & (closing_mps > 0.0)
    return np.where(closes, gap_m / np.where(closes, closing_mps, 1.0), np.inf)


def drac_mps2(gap_m: Array, closing_mps: Array) -> Array:
    """Return the constant deceleration that just avoids a collision, m/s2; 0 where a gap does not close, (n,)."""
    closes = (gap_m > 0.0) & (closing_mps > 0.0)
    return np.where(closes, closing_mps**2 / (2.0 * np.where(closes, gap_m, 1.0)), 0.0)


def driving_of(
    recording: Recording, surroundings: Surroundings | None = None, every_s: float = EVERY_S
) -> VehicleMotions:
    """Return what the vehicles of a recording did, one row each `every_s`. Parked vehicles have no rows meanwhile."""
    stride = max(1, round(every_s / recording.step_s))
    tracks = list(recording.tracks.values())
    rows = [_rows(recording, track, stride) for track in tracks]
    vehicle = np.repeat(np.arange(len(tracks)), [len(part) for part in rows])

    def column(name: str) -> Array:
        parts = [np.asarray(getattr(track, name))[part] for track, part in zip(tracks, rows, strict=True)]
        return np.concatenate(parts) if parts else np.empty(0)

    step = np.concatenate([np.empty(0, np.int64), *(t.first_step + part for t, part in zip(tracks, rows, strict=True))])
    acceleration = [_acceleration(recording, track, part) for track, part in zip(tracks, rows, strict=True)]
    speed, length = column("speed"), np.array([track.length_m for track in tracks])
    leader, gap = _leaders(step, column("lane").astype(np.int64), column("lane_pos"), vehicle, length)
    _across_lane_ends(surroundings or Surroundings(recording), vehicle, step, leader, gap)
    closing = np.where(leader >= 0, speed - speed[leader], 0.0) if len(speed) else speed
    return VehicleMotions(
        names=tuple(track.vehicle for track in tracks),
        every_s=stride * recording.step_s,
        vehicle=vehicle,
        time_s=step * recording.step_s,
        x=column("x"),
        y=column("y"),
        speed=speed,
        acceleration=np.concatenate([np.empty(0), *acceleration]),
        ttc_s=time_to_collision_s(gap, closing),
        drac_mps2=drac_mps2(gap, closing),
    )


def _rows(recording: Recording, track: Track, stride: int) -> IntArray:
    """Return the rows of a track at multiples of `stride` steps at which the vehicle is not parked, (n,)."""
    rows = np.arange(-track.first_step % stride, len(track), stride)
    for first, after in recording.parked.get(track.vehicle, ()):
        rows = rows[(rows + track.first_step < first) | (rows + track.first_step >= after)]
    return rows


def _acceleration(recording: Recording, track: Track, rows: IntArray) -> Array:
    """Return the conditioned acceleration along the lane at some rows of a track, m/s2, (n,)."""
    if len(track) < 2:
        return np.zeros(len(rows))
    return condition(np.asarray(track.speed), recording.step_s, SMOOTHING_S, 1, rows)


def _leaders(step: IntArray, lane: IntArray, pos: Array, vehicle: IntArray, length: Array) -> tuple[IntArray, Array]:
    """Return the row of each row's leader in the same lane, -1 without one, and the gap to its rear, m, (n,) each."""
    order = np.lexsort((pos, lane, step))
    leader, gap = np.full(len(step), -1, np.int64), np.full(len(step), np.inf)
    behind, ahead = order[:-1], order[1:]
    together = (step[behind] == step[ahead]) & (lane[behind] == lane[ahead])
    behind, ahead = behind[together], ahead[together]
    leader[behind] = ahead
    gap[behind] = pos[ahead] - length[vehicle[ahead]] - pos[behind]
    return leader, gap


def _across_lane_ends(
    surroundings: Surroundings, vehicle: IntArray, step: IntArray, leader: IntArray, gap: Array
) -> None:
    """Fill in the leaders of the first vehicles of each lane: they are in the lanes that continue it."""
    recording = surroundings.recording
    names = list(recording.tracks)
    number = {name: k for k, name in enumerate(names)}
    first_row = np.searchsorted(vehicle, np.arange(len(names) + 1))
    for row in np.flatnonzero(leader < 0).tolist():
        ahead = surroundings.leader(names[vehicle[row]], step[row] * recording.step_s, LEADER_M)
        if ahead is None:
            continue
        other = number[ahead.vehicle]
        begin, end = first_row[other], first_row[other + 1]
        place = begin + int(np.searchsorted(step[begin:end], step[row]))
        if place < end and step[place] == step[row]:
            leader[row], gap[row] = place, ahead.gap_m


def encroachments(recording: Recording) -> Encroachments:
    """Return the entries into a lane ahead of another vehicle, by time, with their post-encroachment times.

    An entry is a change of lane within an edge. The vehicle behind is the next one behind in the entered lane then; it
    counts if it stays in that lane until it gets to the place of entry, within `LONGEST_PET_S` of the other's leaving.
    """
    edge_number = {name: k for k, name in enumerate(dict.fromkeys(lane.edge for lane in recording.lanes))}
    edges = np.array([edge_number[lane.edge] for lane in recording.lanes], np.int64)
    rows: list[tuple[float, str, str, float]] = []
    for track in recording.tracks.values():
        lane = np.asarray(track.lane)
        for row in (np.flatnonzero((np.diff(lane) != 0) & (edges[lane[1:]] == edges[lane[:-1]])) + 1).tolist():
            place, entered = float(track.lane_pos[row]), int(lane[row])
            behind = _next_behind(recording, track, row)
            if behind is None:
                continue
            left = arrival(track, row, entered, place + track.length_m, recording.step_s, stays=False)
            arrives = arrival(
                behind, track.first_step + row - behind.first_step, entered, place, recording.step_s, stays=True
            )
            if left is None or arrives is None or arrives - left > LONGEST_PET_S:
                continue
            rows.append(((track.first_step + row) * recording.step_s, track.vehicle, behind.vehicle, arrives - left))
    return Encroachments.of(sorted(rows), crossing=False)


def _next_behind(recording: Recording, entering: Track, row: int) -> Track | None:
    """Return the next vehicle behind in the lane that a vehicle has entered at a row of its track."""
    step, lane, place = entering.first_step + row, int(entering.lane[row]), float(entering.lane_pos[row])
    best: tuple[float, Track] | None = None
    for track in recording.tracks.values():
        k = step - track.first_step
        if track is entering or not 0 <= k < len(track) or int(track.lane[k]) != lane:
            continue
        distance = place - float(track.lane_pos[k])
        parked = recording.is_parked(track.vehicle, step, step)
        if distance > 0.0 and not parked and (best is None or distance < best[0]):
            best = distance, track
    return best[1] if best else None


def arrival(track: Track, row: int, lane: int, place_m: float, step_s: float, stays: bool) -> float | None:
    """Return when a vehicle that is in a lane at a row has come to a place along it, s; None if it never does.

    stays: it has to be in that lane all the way; otherwise only the way that it drives counts.
    """
    span = slice(row, row + round(6.0 * LONGEST_PET_S / step_s))
    driven = np.concatenate([[0.0], np.cumsum((track.speed[span][1:] + track.speed[span][:-1]) / 2.0 * step_s)])
    wanted = place_m - float(track.lane_pos[row])
    after = int(np.searchsorted(driven, wanted))
    if after >= len(driven) or (stays and (np.asarray(track.lane[span])[:after] != lane).any()):
        return None
    if after == 0:
        return (track.first_step + row) * step_s
    part = (wanted - driven[after - 1]) / max(driven[after] - driven[after - 1], 1e-12)
    return float((track.first_step + row + after - 1 + part) * step_s)


TTC_S = (3.0, 1.5)
DRAC_MPS2 = 3.4
"""Braking above this is beyond what drivers usually manage (Archer 2005: 3.35 m/s2)."""
PET_S = 1.5


@dataclass(frozen=True)
class Totals:
    """What some vehicles did in some time, summed up.

    hours: vehicle-hours. km: driven. ttc_below_3_s, ttc_below_1_5_s, drac_above_3_4_s: time in which a vehicle was
    there, s. entries_below_1_5, crossings_below_1_5: entries into a lane, and crossings of paths, with a
    post-encroachment time below 1.5 s. drac_highest_mps2, hardest_braking_mps2: the highest of all; 0 without any.
    """

    hours: float
    km: float
    ttc_below_3_s: float
    ttc_below_1_5_s: float
    drac_above_3_4_s: float
    entries_below_1_5: int
    crossings_below_1_5: int
    drac_highest_mps2: float
    hardest_braking_mps2: float

    @classmethod
    def of(cls, driving: VehicleMotions, encroachments: Encroachments, rows: BoolArray, chosen: BoolArray) -> Totals:
        """Sum up chosen rows of the driving, (n,), and chosen encroachments, (m,)."""
        every_s, ttc, drac = driving.every_s, driving.ttc_s[rows], driving.drac_mps2[rows]
        close = chosen & (encroachments.pet_s < PET_S)
        return cls(
            hours=float(rows.sum()) * every_s / 3600.0,
            km=float(driving.speed[rows].sum()) * every_s / 1000.0,
            ttc_below_3_s=float((ttc < TTC_S[0]).sum()) * every_s,
            ttc_below_1_5_s=float((ttc < TTC_S[1]).sum()) * every_s,
            drac_above_3_4_s=float((drac > DRAC_MPS2).sum()) * every_s,
            entries_below_1_5=int((close & ~encroachments.crossing).sum()),
            crossings_below_1_5=int((close & encroachments.crossing).sum()),
            drac_highest_mps2=float(drac.max(initial=0.0)),
            hardest_braking_mps2=float((-driving.acceleration[rows]).max(initial=0.0)),
        )


FIGURES = {
    "ttc_below_3_s": "time below 3 s of time to collision, s per vehicle-hour",
    "ttc_below_1_5_s": "time below 1.5 s of time to collision, s per vehicle-hour",
    "drac_above_3_4_s": "time in which more than 3.4 m/s2 would be needed to avoid a collision, s per vehicle-hour",
    "entries_below_1_5": "entries into a lane with a post-encroachment time below 1.5 s, per vehicle-hour",
    "crossings_below_1_5": "crossings of paths with a post-encroachment time below 1.5 s, per vehicle-hour",
    "drac_highest_mps2": "highest deceleration rate to avoid a collision, m/s2, mean over seeds",
    "hardest_braking_mps2": "hardest deceleration, m/s2, mean over seeds",
    "mean_speed_mps": "mean speed, m/s",
    "travel_s_per_km": "time to drive a kilometre, s",
}
"""The figures of an arm, and their units."""


def figures(totals: Sequence[Totals]) -> dict[str, float]:
    """Return the figures of several seeds together, by the names in FIGURES; NaN where nothing was driven."""
    hours, km = sum(part.hours for part in totals), sum(part.km for part in totals)

    def per_hour(name: str) -> float:
        return float(sum(getattr(part, name) for part in totals)) / hours if hours else np.nan

    def mean(name: str) -> float:
        return float(np.mean([getattr(part, name) for part in totals if part.hours])) if hours else np.nan

    rates = ("ttc_below_3_s", "ttc_below_1_5_s", "drac_above_3_4_s", "entries_below_1_5", "crossings_below_1_5")
    return {
        **{name: per_hour(name) for name in rates},
        **{name: mean(name) for name in ("drac_highest_mps2", "hardest_braking_mps2")},
        "mean_speed_mps": km / hours / 3.6 if hours else np.nan,
        "travel_s_per_km": 3600.0 * hours / km if km else np.nan,
    }
