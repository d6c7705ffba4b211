"""From a recording to its events: runs the detectors and settles precedence where definitions overlap.

Precedence, in this order:

1. An evasive swerve takes in the lane changes and overtakes whose crossing lies within it. A swerve that ends in the
   next lane, or that crosses a marking and returns, is a swerve and nothing else.
2. A lane change by which the vehicle ahead is overtaken is an overtake: of two events of one crossing, the later
   detector's counts. The return stays a lane change. `labeling.samples.candidates` asks again for the UV of each
   sample, because an overtake is about a pair.
3. Everything else keeps its own event: a brake during a lane change or a swerve is two events.
4. Following is where none of these is near.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Literal

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.motion import CAR_MPS2, CAR_MPS3
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.lane_change import LaneChangeDetector
from isac_cosim.labeling.detectors.near_misses import NearMissSettings, near_misses
from isac_cosim.labeling.detectors.protocol import Detector, VehicleView, vehicle_view
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import LANE_CHANGES, Event, Intention
from isac_cosim.labeling.road.road_motion import RoadMotion, slope
from isac_cosim.labeling.road.surroundings import Surroundings

Origin = Literal["natural", "reaction", "commanded"]
"""What made a vehicle drive an event: SUMO's driver alone, the driver model's reaction to a cause in the traffic, or a
command without a cause."""

MIN_TRACK_S = 1.0
"""Shorter tracks are skipped: no event fits in."""
COMMAND_REACH_S = 1.0
"""A command counts as a cause of an event up to this long before its onset, s."""

_CROSSING = (*LANE_CHANGES, Intention.OVERTAKE)


@dataclass(frozen=True)
class Labels:
    """The events of one recording.

    events: after precedence, by onset. changes: for each vehicle all its completed lane changes in order, including
    those within swerves and overtakes. jumps: for each vehicle the times of steps that are not motion, s.
    counts: what is not an event. Crossings that were `dithering`, or `cut_off` by the end of the track; lane changes
    `within_swerve`; and vehicles whose conditioned motion is `beyond_car`, over 9 m/s2 or 25 m/s3, which only a driver
    model can do.
    near_misses: motions just under a threshold, by onset; empty where they were not asked for.
    """

    settings: LabelSettings
    events: tuple[Event, ...]
    changes: dict[str, tuple[Event, ...]]
    jumps: dict[str, tuple[float, ...]]
    counts: dict[str, int]
    near_misses: tuple[Event, ...] = ()

    def of(self, intention: Intention) -> list[Event]:
        """Return the events of one intention, by onset."""
        return [event for event in self.events if event.intention is intention]


def label(
    recording: Recording,
    settings: LabelSettings,
    surroundings: Surroundings | None = None,
    near: NearMissSettings | None = None,
) -> Labels:
    """Find all events of a recording.

    surroundings: of the recording, if already at hand. near: what near misses are, to find them, too. Commands play no
    part; `provenance` is looked up afterwards.
    Raises InputError where a selected detector returns an event that it may not return.
    """
    surroundings = Surroundings(recording) if surroundings is None else surroundings
    lane_changes = LaneChangeDetector(settings.lane_change)
    detectors = {name: d for name, d in settings.active_detectors().items() if not isinstance(d, LaneChangeDetector)}
    events: list[Event] = []
    nearly: list[Event] = []
    changes: dict[str, tuple[Event, ...]] = {}
    jumps: dict[str, tuple[float, ...]] = {}
    counts: Counter[str] = Counter(dithering=0, cut_off=0, within_swerve=0, beyond_car=0)
    for track in recording.tracks.values():
        if len(track) * recording.step_s < MIN_TRACK_S:
            continue
        view = vehicle_view(recording, track.vehicle, surroundings, settings.width_s)
        view = replace(view, lane_changes=tuple(lane_changes.detect(view)))
        vehicle_events = _events_of(view, detectors, settings)
        events += vehicle_events
        nearly += [] if near is None else near_misses(view, vehicle_events, settings, near)
        changes[track.vehicle] = view.lane_changes
        jumps[track.vehicle] = view.motion.jumps
        crossings = lane_changes.crossings(view.motion)
        within_swerve = len(view.lane_changes) - len(outside_swerves(view.lane_changes, vehicle_events))
        counts.update(dithering=crossings.dithering, cut_off=crossings.cut_off, within_swerve=within_swerve)
        counts.update(beyond_car=beyond_car(view.motion))
    for found in (events, nearly):
        found.sort(key=lambda event: (event.onset, event.vehicle, event.intention))
    return Labels(settings, tuple(events), changes, jumps, dict(counts), tuple(nearly))


def _events_of(view: VehicleView, detectors: Mapping[str, Detector], settings: LabelSettings) -> list[Event]:
    """Return all events of one vehicle after precedence. view: with its lane changes."""
    events = [change for change in view.lane_changes if change.intention not in settings.replaced]
    for name, detector in detectors.items():
        detected = list(detector.detect(replace(view, events=tuple(events))))
        if name in settings.detectors:
            _check(name, detector, view, detected)
        else:
            detected = [event for event in detected if event.intention not in settings.replaced]
        events = settled(events, detected)
    return events


def settled(earlier: Sequence[Event], detected: Sequence[Event]) -> list[Event]:
    """Return the events of one vehicle after precedence.

    earlier: those of the detectors before, settled. detected: those of the next detector.
    """
    judged = {event.commit for event in detected if event.intention in _CROSSING}
    kept = [event for event in earlier if event.intention not in _CROSSING or event.commit not in judged]
    return outside_swerves([*kept, *detected], [*kept, *detected])


def outside_swerves(events: Sequence[Event], others: Sequence[Event]) -> list[Event]:
    """Return the events without the lane changes and overtakes whose crossing lies within a swerve among the others."""
    spans = [(other.onset, other.end) for other in others if other.intention is Intention.EVASIVE_SWERVE]
    return [
        event
        for event in events
        if event.intention not in _CROSSING or not any(onset <= event.commit <= end for onset, end in spans)
    ]


def _check(name: str, detector: Detector, view: VehicleView, events: Sequence[Event]) -> None:
    """Raise InputError where a selected detector returns an event that it may not return."""
    for event in events:
        if event.vehicle != view.vehicle or event.intention not in detector.finds:
            wrong = f"an event {event.intention!r} of vehicle {event.vehicle!r} for vehicle {view.vehicle!r}"
        elif not (isfinite(event.onset) and isfinite(event.end) and event.onset <= event.commit <= event.end):
            wrong = f"an event with onset {event.onset}, commit {event.commit} and end {event.end}"
        else:
            continue
        raise InputError(f"detector {name}: returned {wrong}; fix the detector")


def beyond_car(motion: RoadMotion) -> bool:
    """Return whether a vehicle ever accelerates by more than 9 m/s2, or changes that by more than 25 m/s3.

    Motion along and across the road counts, the bends of the road do not: they are counted in the plane, and for the
    records only (`labeling.samples.candidates`).
    """
    step_s = float(motion.times[1] - motion.times[0])
    jerk = np.hypot(slope(motion.a, step_s), slope(motion.aq, step_s))
    return bool(np.hypot(motion.a, motion.aq).max() > CAR_MPS2 or jerk.max() > CAR_MPS3)


@dataclass(frozen=True)
class Provenance:
    """What made a vehicle drive an event.

    cause: name of what the driver reacted to, empty unless `origin` is `reaction`. cause_ttc_s: time to collision when
    the driver began to move, s; NaN where there was nothing to collide with, and without a reaction.
    """

    origin: Origin
    cause: str = ""
    cause_ttc_s: float = nan


def provenance(recording: Recording, event: Event) -> Provenance:
    """Return what made a vehicle drive an event: the last of the commands and reactions that it was under.

    Those count that were under way at any time from 1 s before onset to the end of the motion that belongs to the
    event: of an overtake, that is the pulling-out and not the return. The label plays no part.
    """
    earliest = event.onset - COMMAND_REACH_S
    commands = [
        command
        for command in recording.commands_to.get(event.vehicle, [])
        if command.start <= event.busy_until and command.end >= earliest
    ]
    if not commands:
        return Provenance("natural")
    last = max(commands, key=lambda command: command.start)
    if not last.cause:
        return Provenance("commanded")
    return Provenance("reaction", last.cause, nan if last.ttc_s is None else last.ttc_s)
