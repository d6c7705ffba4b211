"""Labels against what does not come from the labels: SUMO's own lane-change output, and the commands that were given.

Minutes long. The commanded maneuvers count where the raw states show that the vehicle really moved so, by other means
than the detectors': plain differences over 0.2 s, no conditioning.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isacsim.maneuvers import ManeuverSettings
from isacsim.recording import Command, Recording, Track
from isacsim.scenario import bundled, load
from isacsim.traffic import TrafficSettings, record
from labeling.events import Labels, LabelSettings, label
from labeling.intentions import Event, Intention

pytestmark = pytest.mark.slow

LATERAL = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE)


@pytest.fixture(scope="module", params=sorted(bundled()))
def witnessed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """Ten minutes of a bundled scenario with SUMO's own account of lane changes."""
    import libsumo

    output = tmp_path_factory.mktemp("witness") / "changes.xml"
    start: Callable[[list[str]], Any] = libsumo.start
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(libsumo, "start", lambda args: start([*args, "--lanechange-output", str(output)]))
        recording = record(load(request.param), 11, TrafficSettings(duration_s=600.0), ManeuverSettings())
    return recording, output


def accounts(output: Path, recording: Recording) -> list[tuple[str, float, bool]]:
    """SUMO's changes of recorded vehicles in the recorded time: vehicle, time (s), leftwards."""
    found = []
    for change in ET.parse(output).getroot().iter("change"):
        vehicle, time = change.get("id", ""), float(change.get("time", "nan"))
        track = recording.tracks.get(vehicle)
        if track is not None and recording.times(track)[0] < time < recording.times(track)[-1]:
            found.append((vehicle, time, int(change.get("dir", "0")) > 0))
    return found


def stays_across(track: Track, recording: Recording, time: float, left: bool) -> bool | None:
    """Whether the lane index is on the new side for a second after a change; None if the track ends within it.

    On one edge alone: an edge that ends within the second is taken to number its lanes as before if no change is near.
    """
    times = recording.times(track)
    k = int(np.searchsorted(times, time - 1e-6))
    after = track.lane[k + 1 : k + 1 + round(1.0 / recording.step_s)]
    if len(after) < round(1.0 / recording.step_s):
        return None
    here = recording.lanes[int(after[0])]
    for lane in map(recording.lanes.__getitem__, np.unique(after).tolist()):
        if lane.edge == here.edge and (lane.index < here.index if left else lane.index > here.index):
            return False
    return True


def test_lane_changes_against_sumo_s_own_account(witnessed: tuple[Recording, Path]) -> None:
    recording, output = witnessed
    labels = label(recording, LabelSettings())
    told = accounts(output, recording)
    matched: set[tuple[str, float]] = set()
    completed = missed = dithering = cut_off = 0
    poked: dict[str, bool] = {}
    for vehicle, time, left in told:
        hit = [
            e for e in labels.changes[vehicle] if abs(e.commit - time) < 0.06 and (e.intention is LATERAL[0]) is left
        ]
        matched |= {(vehicle, e.commit) for e in hit}
        stays = stays_across(recording.tracks[vehicle], recording, time, left)
        # What undoes a poke across a marking is part of the dithering: the vehicle ends where it was.
        if stays and poked.pop(vehicle, left) is not left:
            stays = False
        elif stays is False:
            poked[vehicle] = left
        if stays is None:
            cut_off += 1
        elif stays:
            completed += 1
            missed += not hit
        else:
            dithering += 1
            missed += bool(hit)
    events = [(e.vehicle, e.commit) for own in labels.changes.values() for e in own]
    invented = [e for e in events if e not in matched]
    print(f"\n{recording.scenario}: {completed} completed, {missed} missed, {len(invented)} invented, ", end="")
    print(f"{dithering} dithering, {cut_off} cut off; labels: {labels.counts}")
    assert completed > 200
    assert missed <= 0.005 * completed
    assert not invented


def band_left(track: Track, recording: Recording, event: Event) -> float | None:
    """When the raw lateral position leaves the 5 cm around where it rested for a second before the change, s."""
    times = recording.times(track)
    crossing = int(np.searchsorted(times, event.commit - 1e-6))
    same = np.flatnonzero(track.lane[:crossing] != track.lane[crossing - 1])
    first = int(same[-1]) + 1 if len(same) else 0
    lateral = track.lane_lat[first:crossing]
    for end in range(len(lateral) - 1, 100, -1):
        if np.ptp(lateral[end - 100 : end]) < 0.01:
            away = np.flatnonzero(np.abs(lateral[end:] - lateral[end - 100]) > 0.05)
            return float(times[first + end + away[0]]) if len(away) else None
    return None


def test_onset_against_the_raw_lateral_position(witnessed: tuple[Recording, Path]) -> None:
    recording, _ = witnessed
    labels = label(recording, LabelSettings())
    errors = []
    for own in labels.changes.values():
        for event in own:
            left_at = band_left(recording.tracks[event.vehicle], recording, event)
            if left_at is not None:
                errors.append(event.onset - left_at)
    print(f"\n{recording.scenario}: onset error over {len(errors)}: quartiles {np.percentile(errors, [25, 50, 75])}")
    assert len(errors) > 150
    assert np.median(np.abs(errors)) <= 0.15


def longest(mask: np.ndarray, step_s: float) -> float:
    """The longest stretch in which a mask holds, s."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return float((edges[1::2] - edges[::2]).max(initial=0) * step_s)


def moved_so(recording: Recording, command: Command) -> Intention | None:
    """What the raw states show of a commanded maneuver, with some room to the definitions."""
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
        mean = np.convolve(lateral, np.ones(n) / n, "valid")
        across = (mean[2 * n :] - 2 * mean[n:-n] + mean[: -2 * n]) / (n * recording.step_s) ** 2
        return Intention.EVASIVE_SWERVE if min(across.max(), -across.min()) >= 3.6 else None
    if command.maneuver == "lane_change":
        flips = [k for k in np.flatnonzero(lane[1:] != lane[:-1]) if _beside(recording, lane[k], lane[k + 1])]
        if len(flips) == 1 and len(lane) - flips[0] > round(1.5 / recording.step_s):
            left = recording.lanes[lane[flips[0] + 1]].index > recording.lanes[lane[flips[0]]].index
            return LATERAL[0] if left else LATERAL[1]
    return None


def _beside(recording: Recording, a: int, b: int) -> bool:
    return recording.lanes[a].edge == recording.lanes[b].edge


RATES = ManeuverSettings(
    hard_brake_per_vehicle_hour=20.0,
    hard_accel_per_vehicle_hour=40.0,
    left_change_per_vehicle_hour=15.0,
    right_change_per_vehicle_hour=15.0,
    swerve_per_vehicle_hour=20.0,
)


def test_what_was_commanded_and_driven_is_labelled() -> None:
    """Recall of stimulated maneuvers, and that none is taken for another intention of the same direction of motion."""
    wanted: dict[Intention, int] = defaultdict(int)
    found: dict[Intention, int] = defaultdict(int)
    misses: list[str] = []
    for seed in range(101, 105):
        recording = record(load("motorway"), seed, TrafficSettings(duration_s=240.0), RATES)
        labels = label(recording, LabelSettings())
        for command in recording.commands:
            intention = moved_so(recording, command) if command.vehicle in recording.tracks else None
            if intention is None:
                continue
            wanted[intention] += 1
            got = during(labels, command)
            if intention in got or (intention is LATERAL[0] and Intention.OVERTAKE in got):
                found[intention] += 1
            else:
                misses.append(f"{seed} {command} {sorted(i.text for i in got)}")
    print("\n" + "\n".join([f"{i.text}: {found[i]} of {n}" for i, n in wanted.items()] + misses))
    assert {Intention.HARD_BRAKE, Intention.HARD_ACCEL, Intention.EVASIVE_SWERVE, *LATERAL} == set(wanted)
    assert all(found[i] >= 0.99 * n for i, n in wanted.items())


def during(labels: Labels, command: Command) -> set[Intention]:
    """What the commanded vehicle was found to do meanwhile."""
    return {
        e.intention
        for e in labels.events
        if e.vehicle == command.vehicle and e.onset <= command.end and e.end >= command.start
    }


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
    """Plain overtakes by raw geometry: one lane out, past the vehicle next in the lane, one lane back within 27 s."""
    changes, found = flips(recording, track), []
    start, end = recording.times(track)[[0, -1]]
    for (out, first), (back, second) in pairwise(changes):
        # From within its own lane: one that waits at the marking may be alongside already, and then overtakes nobody.
        row = round((out - 4.0) / recording.step_s) - track.first_step
        alone = abs(track.lane_lat[max(row, 0)]) < 0.5 and all(
            time in (out, back) or min(abs(time - out), abs(time - back)) > 5.0 for time, _ in changes
        )
        seen = out - 5.0 > start and back + 2.0 < end
        if (first, second) != (1, -1) or not (alone and seen and 2.0 < back - out < 27.0):
            continue
        other = next_in_lane(recording, track, out - 4.0)
        gap = None if other is None else along(recording, track, other, out - 4.0)
        later = None if other is None else along(recording, track, other, back)
        if other is not None and gap is not None and gap < 60.0 and later is not None and later < -track.length_m - 2.0:
            found.append((out, other.vehicle))
    return found


def test_overtakes_seen_in_the_plane_are_labelled() -> None:
    """Drivers' own and commanded ones: by positions in the plane, without stations or the network's connections."""
    total, misses = 0, []
    for seed in range(201, 213):
        recording = record(load("motorway"), seed, TrafficSettings(duration_s=240.0), ManeuverSettings())
        events = label(recording, LabelSettings()).of(Intention.OVERTAKE)
        told = {(e.vehicle, round(e.commit, 2), e.other) for e in events}
        for track in recording.tracks.values():
            for out, other in overtaken(recording, track):
                total += 1
                if (track.vehicle, round(out, 2), other) not in told:
                    misses.append(f"{seed} {track.vehicle} at {out:.2f} past {other}")
    print(f"\novertake: {total - len(misses)} of {total}", *misses, sep="\n")
    assert total >= 100
    assert len(misses) <= 0.01 * total
