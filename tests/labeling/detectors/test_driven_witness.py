"""Maneuvers that vehicles drove, commanded ones and overtakes, compared with their labels.

Takes minutes. What a vehicle drove is determined from raw states by other means than those of the detectors: plain
differences over 0.2 s and positions in the plane, without conditioning. Prints the counts.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.maneuvers.lane_change import LaneChangeCommandSettings
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Command, Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import LANE_CHANGES, Event, Intention

pytestmark = pytest.mark.slow

LEFT, RIGHT = LANE_CHANGES
LATERAL = {*LANE_CHANGES, Intention.OVERTAKE, Intention.EVASIVE_SWERVE}
LONGITUDINAL = {Intention.HARD_BRAKE, Intention.HARD_ACCEL}


def longest(mask: np.ndarray, step_s: float) -> float:
    """The longest stretch in which a mask holds, s."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return float((edges[1::2] - edges[::2]).max(initial=0) * step_s)


def moved_so(recording: Recording, command: Command) -> Intention | None:
    """The intention that the raw states show of a commanded maneuver, with some margin to the definitions.

    A lane change counts if it is the only one from 1.5 s before the command to its end. Crossing back over a marking
    that was crossed a moment before only undoes a change.
    """
    track = recording.tracks[command.vehicle]
    times = recording.times(track)
    span = (times >= command.start) & (times <= command.end)
    n = round(0.1 / recording.step_s)
    speed = track.speed[span]
    if times[0] > command.start - 1.0 or times[-1] < command.end + 1.0 or len(speed) < 4 * n:
        return None
    accel = (speed[2 * n :] - speed[: -2 * n]) / (2 * n * recording.step_s)
    if command.maneuver == "hard_brake" and longest(accel <= -4.2, recording.step_s) >= 0.7:
        return Intention.HARD_BRAKE
    if command.maneuver == "hard_accel" and longest(accel >= 2.6, recording.step_s) >= 1.2:
        return Intention.HARD_ACCEL
    lane, lateral = track.lane[span], track.lane_lat[span]
    if command.maneuver == "evasive_swerve" and (lane == lane[0]).all() and np.ptp(lateral) > 0.5:
        # Means and differences over 0.3 s are about as smooth as the conditioned motion.
        mean = np.convolve(lateral, np.ones(3 * n) / (3 * n), "valid")
        across = (mean[6 * n :] - 2 * mean[3 * n : -3 * n] + mean[: -6 * n]) / (3 * n * recording.step_s) ** 2
        aside = np.sign(lateral[np.abs(lateral - lateral[0]).argmax()] - lateral[0])
        sharp = (aside * across).max() >= 3.3 and (aside * across).min() <= -1.8
        return Intention.EVASIVE_SWERVE if sharp else None
    if command.maneuver == "lane_change":
        near = [(time, side) for time, side in flips(recording, track) if command.start - 1.5 < time <= command.end]
        if len(near) == 1 and command.start < near[0][0] < command.end - 1.5:
            return LEFT if near[0][1] > 0 else RIGHT
    return None


RATES = ManeuverSettings(
    hard_brake_per_vehicle_hour=20.0,
    hard_accel_per_vehicle_hour=40.0,
    left_change_per_vehicle_hour=15.0,
    right_change_per_vehicle_hour=15.0,
    swerve_per_vehicle_hour=30.0,
    lane_change=LaneChangeCommandSettings(clear_s=0.0),  # anywhere, so that there are many
)


def test_what_was_commanded_and_driven_is_labelled() -> None:
    """Stimulated maneuvers are found, and none is taken for another intention along or across the road."""
    wanted: dict[Intention, int] = defaultdict(int)
    labelled: dict[Intention, int] = defaultdict(int)
    misses, wrong = [], []
    for seed in range(101, 111):
        recording = record(load("motorway"), seed, TrafficSettings(duration_s=240.0), RATES)
        labels = label(recording, LabelSettings())
        for command in recording.commands:
            intention = moved_so(recording, command) if command.vehicle in recording.tracks else None
            if intention is None:
                continue
            wanted[intention] += 1
            events = under_way(labels, command)
            intentions = {event.intention for event in events}
            fits = {intention, Intention.OVERTAKE} if intention is LEFT else {intention}
            labelled[intention] += bool(fits & intentions)
            line = f"{seed} {command} {sorted(i.text for i in intentions)}"
            if not fits & intentions:
                misses.append(line)
            related = (LATERAL if intention in LATERAL else LONGITUDINAL) - fits
            begun = [event for event in events if command.start <= event.commit]
            if any(event.intention in related and not really(recording, event) for event in begun):
                wrong.append(line)
    print("\n" + "\n".join(f"{i.text}: {labelled[i]} of {n}" for i, n in wanted.items()))
    print("missed:", *misses or ["none"], "wrong:", *wrong or ["none"], sep="\n")
    assert {*LONGITUDINAL, *LATERAL} - {Intention.OVERTAKE} == set(wanted)
    assert all(n >= 100 and labelled[i] >= 0.99 * n for i, n in wanted.items())
    assert not wrong


def under_way(labels: Labels, command: Command) -> list[Event]:
    """The events of the commanded vehicle that have committed and not ended at some time of the command."""
    events = (event for event in labels.events if event.vehicle == command.vehicle)
    return [event for event in events if event.commit <= command.end and command.start <= event.end]


def really(recording: Recording, event: Event) -> bool:
    """Whether the raw speed shows a brake or an acceleration after its commit: drivers do more than is commanded."""
    track = recording.tracks[event.vehicle]
    n = round(0.1 / recording.step_s)
    accel = (track.speed[2 * n :] - track.speed[: -2 * n]) / (2 * n * recording.step_s)
    times = recording.times(track)[n:-n]
    after = accel[(times >= event.commit) & (times <= event.commit + 1.5)]
    if event.intention is Intention.HARD_BRAKE:
        return longest(after <= -3.6, recording.step_s) >= 0.4
    return event.intention is Intention.HARD_ACCEL and longest(after >= 2.2, recording.step_s) >= 0.8


def flips(recording: Recording, track: Track) -> list[tuple[float, int]]:
    """Raw changes of the lane index on one edge: time (s), +1 leftwards or -1."""
    times, lanes = recording.times(track), recording.lanes
    at = np.flatnonzero(track.lane[1:] != track.lane[:-1])
    pairs = [(float(times[k + 1]), lanes[track.lane[k]], lanes[track.lane[k + 1]]) for k in at]
    return [(time, int(np.sign(b.index - a.index))) for time, a, b in pairs if a.edge == b.edge]


def next_in_lane(recording: Recording, track: Track, time: float) -> Track | None:
    """The nearest vehicle further on in the very same lane, from raw positions."""
    step = round(time / recording.step_s)
    k = step - track.first_step
    ahead = []
    for other in recording.tracks.values():
        j = step - other.first_step
        if 0 <= j < len(other) and other.lane[j] == track.lane[k] and other.lane_pos[j] > track.lane_pos[k]:
            ahead.append((float(other.lane_pos[j]), other))
    return min(ahead, key=lambda item: item[0])[1] if ahead else None


def along(recording: Recording, track: Track, other: Track, time: float) -> float | None:
    """How far the other is ahead in the direction in which a vehicle moves, in the plane, m."""
    step = round(time / recording.step_s)
    k, j = step - track.first_step, step - other.first_step
    if not (10 <= k < len(track) and 0 <= j < len(other)):
        return None
    heading = np.array([track.x[k] - track.x[k - 10], track.y[k] - track.y[k - 10]])
    apart = np.array([other.x[j] - track.x[k], other.y[j] - track.y[k]])
    return float(apart @ heading / max(np.linalg.norm(heading), 1e-9))


def overtaken(recording: Recording, track: Track) -> list[tuple[float, str]]:
    """Plain overtakes by raw geometry: one lane out, past the vehicle next in the lane, one lane back within 23 s.

    An overtake has 30 s from its onset, which drivers put up to 7 s before the crossing. The other vehicle is next in
    the lane from 7 s to 1 s before the crossing. One that leaves the lane meanwhile is not the reason for pulling out,
    although it may be passed, and another may be next by then.
    """
    changes, overtakes = flips(recording, track), []
    start, end = recording.times(track)[[0, -1]]
    for (out, first), (back, second) in pairwise(changes):
        # It starts within its lane: a vehicle that waits at the marking may already be alongside.
        row = round((out - 7.0) / recording.step_s) - track.first_step
        alone = abs(track.lane_lat[max(row, 0)]) < 0.5 and all(
            time in (out, back) or min(abs(time - out), abs(time - back)) > 10.0 for time, _ in changes
        )
        seen = out - 8.0 > start and back + 2.0 < end
        if (first, second) != (1, -1) or not (alone and seen and 2.0 < back - out < 23.0):
            continue
        ahead = [next_in_lane(recording, track, out - before) for before in (7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)]
        other = ahead[0] if all(track_ahead is ahead[0] for track_ahead in ahead) else None
        gap = None if other is None else along(recording, track, other, out - 4.0)
        later = None if other is None else along(recording, track, other, back)
        if other is not None and gap is not None and gap < 60.0 and later is not None and later < -track.length_m - 2.0:
            overtakes.append((out, other.vehicle))
    return overtakes


def test_overtakes_seen_in_the_plane_are_labelled() -> None:
    """Commanded and other overtakes, by positions in the plane, without the connections of the network."""
    total, misses = 0, []
    for seed in range(201, 218):
        recording = record(load("motorway"), seed, TrafficSettings(duration_s=240.0), ManeuverSettings())
        events = label(recording, LabelSettings()).of(Intention.OVERTAKE)
        labelled = {(e.vehicle, round(e.commit, 2), e.other) for e in events}
        for track in recording.tracks.values():
            for out, other in overtaken(recording, track):
                total += 1
                if (track.vehicle, round(out, 2), other) not in labelled:
                    misses.append(f"{seed} {track.vehicle} at {out:.2f} past {other}")
    print(f"\novertake: {total - len(misses)} of {total}", *misses, sep="\n")
    assert total >= 100
    assert len(misses) <= 0.01 * total
