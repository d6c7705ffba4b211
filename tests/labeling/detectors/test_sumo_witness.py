"""Lane changes compared with SUMO's own output, and one recording at two sampling rates.

Takes minutes: ten simulated minutes of every bundled scenario. Prints the counts.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from isac_cosim.base import landlock
from isac_cosim.isacsim.scenarios.scenario import bundled, load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from tests.support.drives import thinned

pytestmark = pytest.mark.slow

LEFT = Intention.LEFT_LANE_CHANGE
STAY_S = 1.0
SEED = 11
Fate = Literal["completed", "poke", "return", "cut_off"]


@dataclass(frozen=True)
class Scene:
    """A recording, its labels and the file of SUMO's lane changes. steady: the same traffic without sway."""

    recording: Recording
    steady: Recording
    labels: Labels
    output: Path


@dataclass(frozen=True)
class Change:
    """A lane change in SUMO's output. time: of the first recorded state in the new lane, s.

    fate: `completed`, the centre stays across the marking for a second; `poke`, it crosses back before that; `return`,
    that crossing back; `cut_off`, the vehicle leaves, or the recording ends, before the second is over.
    across_s: how long the centre stays across.
    """

    vehicle: str
    time: float
    left: bool
    fate: Fate
    across_s: float


@pytest.fixture(scope="module", params=sorted(bundled().keys() - {"straight_road_rectangle", "motorway_sparse"}))
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Ten minutes of a bundled scenario."""
    import libsumo

    output = tmp_path_factory.mktemp("witness") / "changes.xml"
    start: Callable[[list[str]], Any] = libsumo.start
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(landlock, "version", lambda: 0)  # SUMO writes a file here
        patch.setattr(libsumo, "start", lambda args: start([*args, "--lanechange-output", str(output)]))
        steady = record(
            load(request.param),
            11,
            TrafficSettings(duration_s=600.0, sway=SwaySettings(sd_m=(0, 0))),
            ManeuverSettings(),
        )
    recording = replace(steady, tracks=copy.deepcopy(steady.tracks))
    add_sway(
        recording.tracks.values(), steady.lanes, steady.step_s, SwaySettings(), steady.lefthand, steady.scenario, 11
    )
    return Scene(recording, steady, label(recording, LabelSettings()), output)


def accounts(output: Path, recording: Recording) -> list[Change]:
    """The lane changes in SUMO's output, of recorded vehicles while they are recorded."""
    reported: dict[str, list[tuple[float, bool]]] = defaultdict(list)
    for entry in ET.parse(output).getroot().iter("change"):
        vehicle = entry.get("id", "")
        # SUMO names the instant before the step that brings the vehicle over.
        time = float(entry.get("time", "nan")) + recording.step_s
        track = recording.tracks.get(vehicle)
        if track is not None and recording.times(track)[0] + 1e-6 < time < recording.times(track)[-1] + 1e-6:
            # SUMO counts lanes from the outer one, which is on the left where traffic keeps left.
            inwards = int(entry.get("dir", "0")) > 0
            reported[vehicle].append((time, inwards != recording.lefthand))
    result = []
    for vehicle, changes in reported.items():
        end = float(recording.times(recording.tracks[vehicle])[-1])
        of_marking: dict[int, list[tuple[float, bool]]] = defaultdict(list)
        level = 0
        for time, left in sorted(changes):
            of_marking[level if left else level - 1].append((time, left))
            level += 1 if left else -1
        for crossings in of_marking.values():
            result += [Change(vehicle, *fate) for fate in fates(crossings, end)]
    return sorted(result, key=lambda change: (change.vehicle, change.time))


def fates(changes: list[tuple[float, bool]], end: float) -> list[tuple[float, bool, Fate, float]]:
    """The fate of each crossing (time, leftwards) of one marking by one vehicle, whose track ends at `end`, s."""
    result: list[tuple[float, bool, Fate, float]] = []
    settled_left = not changes[0][1]
    for k, (time, left) in enumerate(changes):
        last = k + 1 == len(changes)
        across = (end if last else changes[k + 1][0]) - time
        fate: Fate = "poke"
        if left == settled_left:
            fate = "return"
        elif across >= STAY_S - 1e-6:
            fate, settled_left = "completed", left
        elif last:
            fate = "cut_off"
        result.append((time, left, fate, across))
    return result


def evasions(recording: Recording) -> dict[str, list[tuple[float, float]]]:
    """Begin and end of each evasion and swerve, s, by vehicle. The driver model steers; SUMO reports no lane change."""
    result: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for command in recording.commands:
        if command.maneuver in ("evasion", "evasive_swerve"):
            result[command.vehicle].append((command.start, command.end))
    return result


def test_lane_changes_against_sumo_s_own_output(scene: Scene) -> None:
    """Every change in SUMO's output is labelled or has a reason not to be; every event has its change or an evasion."""
    recording, labels = scene.recording, scene.labels
    reported = accounts(scene.output, recording)
    matched: set[tuple[str, float]] = set()
    missed, labelled = [], []
    for change in reported:
        matches = [
            (e.vehicle, e.commit)
            for e in labels.changes[change.vehicle]
            if abs(e.commit - change.time) < 0.06 and (e.intention is LEFT) is change.left
        ]
        matched.update(matches)
        if change.fate == "completed" and not matches:
            missed.append(change)
        if change.fate != "completed" and matches:
            labelled.append(change)
    events = {(e.vehicle, e.commit) for changes in labels.changes.values() for e in changes}
    steered = evasions(recording)
    in_evasions = {
        (vehicle, commit) for vehicle, commit in events if any(a < commit < b for a, b in steered.get(vehicle, []))
    }
    others = replace(recording, tracks={name: track for name, track in recording.tracks.items() if name not in steered})
    counts = label(others, LabelSettings()).counts
    by_fate = {
        fate: [c for c in reported if c.fate == fate and c.vehicle in others.tracks]
        for fate in ("poke", "return", "cut_off")
    }
    completed = [change for change in reported if change.fate == "completed"]
    dithering = by_fate["poke"] + by_fate["return"]
    most = max((c.across_s for c in by_fate["poke"]), default=0.0)
    print(
        f"\n{recording.scenario}: {len(completed)} completed, {len(missed)} missed, {len(events - matched)} of"
        f" {len(events)} events not reported, {len(events - matched - in_evasions)} of them outside evasions; in the"
        f" {len(others.tracks)} vehicles that evade nothing: {len(dithering)} dithering by"
        f" {len({c.vehicle for c in dithering})} vehicles: {len(by_fate['poke'])} back within {most:.2f} s and"
        f" {len(by_fate['return'])} crossings back, {len(labelled)} labelled; {len(by_fate['cut_off'])} cut off;"
        f" the labels' counts: {counts}",
        *missed, *labelled, *sorted(events - matched - in_evasions), sep="\n",
    )  # fmt: skip
    assert len(completed) > 200
    assert len(missed) <= 0.005 * len(completed)
    assert events - matched <= in_evasions
    assert not labelled
    assert counts["dithering"] == len(dithering)
    assert counts["cut_off"] == len(by_fate["cut_off"])


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


def test_onset_against_the_raw_lateral_position(scene: Scene) -> None:
    """Without sway, because a driver who sways does not rest."""
    recording, errors = scene.steady, []
    for changes in label(recording, LabelSettings()).changes.values():
        for event in changes:
            left_at = band_left(recording.tracks[event.vehicle], recording, event)
            if left_at is not None:
                errors.append(event.onset - left_at)
    print(
        f"\n{recording.scenario}: onset error over {len(errors)}: quartiles"
        f" {np.percentile(errors, [25, 50, 75]).round(3)} s, median size {np.median(np.abs(errors)):.3f} s"
    )
    assert len(errors) > 150
    assert np.median(np.abs(errors)) <= 0.15


def unmatched(events: tuple[Event, ...], others: tuple[Event, ...]) -> list[Event]:
    """The events without one of the same vehicle and intention among the others whose three times are within 0.1 s."""
    of: dict[tuple[str, Intention], list[Event]] = defaultdict(list)
    for other in others:
        of[other.vehicle, other.intention].append(other)
    return [e for e in events if not any(np.abs(times(e) - times(o)).max() <= 0.1 for o in of[e.vehicle, e.intention])]


def times(event: Event) -> np.ndarray:
    return np.array([event.onset, event.commit, event.end])


def test_thinned_to_20_hz_the_events_are_the_same(scene: Scene) -> None:
    fine, coarse = scene.labels.events, label(thinned(scene.recording, 5), LabelSettings()).events
    lost, added = unmatched(fine, coarse), unmatched(coarse, fine)
    maneuvers = [[e for e in events if e.intention is not Intention.FOLLOWING] for events in (fine, lost, added)]
    print(
        f"\n{scene.recording.scenario} at 100 and 20 Hz: {len(lost)} of {len(fine)} events unmatched,"
        f" {len(added)} of {len(coarse)} new; without following {len(maneuvers[1])} of {len(maneuvers[0])},"
        f" {len(maneuvers[2])} new"
    )
    assert len(fine) > 1000
    for some, all_ in ((lost, fine), (added, coarse), (maneuvers[1], maneuvers[0]), (maneuvers[2], maneuvers[0])):
        assert len(some) <= 0.02 * len(all_)
