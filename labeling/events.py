"""From a recording to its events: every detector, and what takes precedence where definitions overlap.

Precedence, in this order:

1. An evasive swerve takes in the lane changes whose crossing lies within it: a swerve that ends in the next lane, or
   pokes across a marking and returns, is a swerve and nothing else.
2. A left lane change by which the vehicle ahead was overtaken is an overtake. For another vehicle than the one ahead
   `labeling.samples.candidates` asks again: an overtake is about the pair. The return stays a right lane change.
3. Everything else keeps its own event: a brake during a lane change or a swerve is two events.
4. Following is where none of these is near.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from isacsim.settings import Settings
from isacsim.traffic.recording import Recording, Track
from labeling.detectors.evasive_swerve import EvasiveSwerve, EvasiveSwerveSettings
from labeling.detectors.following import Following, FollowingSettings
from labeling.detectors.hard_accel import HardAccel, HardAccelSettings
from labeling.detectors.hard_brake import HardBrake, HardBrakeSettings
from labeling.detectors.lane_change import LaneChange, LaneChangeSettings
from labeling.detectors.overtake import Overtake, OvertakeSettings
from labeling.intentions import Event, Intention
from labeling.road.road_motion import RoadMotion, road_motion, slope
from labeling.road.surroundings import Surroundings

Origin = Literal["natural", "stimulated"]

CAR_MPS2, CAR_MPS3 = 9.0, 25.0
"""What a passenger car can do: acceleration, m/s2, and its change, m/s3."""
MIN_TRACK_S = 1.0
"""Shorter tracks hold no event that could be told."""
PRESET = "isac-1"
"""Name and version of the default definitions. Other defaults are another preset."""


class LabelSettings(Settings):
    """What counts as each intention. `preset` names the set of values: other values need another name.

    width_s is one of the definitions, since the thresholds are for motion so smoothed: what is sensed may be
    conditioned otherwise (`isacsim.traffic.motion.MotionSettings`), and the events stay the same.
    """

    preset: str = Field(PRESET, min_length=1, description="name and version of these definitions")
    width_s: float = Field(0.15, gt=0.0, le=1.0, description="standard deviation of the conditioning kernel, s")
    lane_change: LaneChangeSettings = LaneChangeSettings()
    overtake: OvertakeSettings = OvertakeSettings()
    hard_brake: HardBrakeSettings = HardBrakeSettings()
    hard_accel: HardAccelSettings = HardAccelSettings()
    evasive_swerve: EvasiveSwerveSettings = EvasiveSwerveSettings()
    following: FollowingSettings = FollowingSettings()

    @model_validator(mode="after")
    def _truly_named(self) -> Self:
        changed = [n for n, f in type(self).model_fields.items() if n != "preset" and getattr(self, n) != f.default]
        if self.preset == PRESET and changed:
            raise ValueError(
                f"{changed[0]} is not that of preset {PRESET}; give these definitions a preset name of their own"
            )
        return self


@dataclass(frozen=True)
class Labels:
    """The events of one recording.

    events: after precedence, by onset. changes: of each vehicle all its completed lane changes in order, those within
    swerves and overtakes too. jumps: of each vehicle the times of steps that are no motion, s. counts: of what is not
    an event: crossings that were `dithering` or `cut_off` by the track's end, lane changes `within_swerve`, and
    vehicles whose conditioned motion goes `beyond_car`, over 9 m/s2 or 25 m/s3, which their driver model alone does.
    """

    settings: LabelSettings
    events: tuple[Event, ...]
    changes: dict[str, tuple[Event, ...]]
    jumps: dict[str, tuple[float, ...]]
    counts: dict[str, int]

    def of(self, intention: Intention) -> list[Event]:
        """The events of one intention, by onset."""
        return [event for event in self.events if event.intention is intention]


def label(recording: Recording, settings: LabelSettings, around: Surroundings | None = None) -> Labels:
    """Find all events of a recording.

    around: the recording's surroundings, where the caller has them already.
    Commands are not looked at: `origin` tells provenance afterwards.
    """
    around = Surroundings(recording) if around is None else around
    events: list[Event] = []
    changes: dict[str, tuple[Event, ...]] = {}
    jumps: dict[str, tuple[float, ...]] = {}
    counts: Counter[str] = Counter(dithering=0, cut_off=0, within_swerve=0, beyond_car=0)
    lane_change = LaneChange(settings.lane_change)
    for track in recording.tracks.values():
        if len(track) * recording.step_s < MIN_TRACK_S:
            continue
        motion = road_motion(recording, track, around.graph, settings.width_s)
        jumps[track.vehicle] = motion.jumps
        changes[track.vehicle] = tuple(lane_change.detect(motion))
        crossings = lane_change.crossings(motion)
        counts.update(dithering=crossings.dithering, cut_off=crossings.cut_off, beyond_car=beyond_car(motion))
        own = _events_of(around, track, motion, changes[track.vehicle], settings)
        events += own
        kept = sum(event.intention in _CROSSING for event in own)
        counts["within_swerve"] += len(changes[track.vehicle]) - kept
    events.sort(key=lambda e: (e.onset, e.vehicle, e.intention))
    return Labels(settings, tuple(events), changes, jumps, dict(counts))


def beyond_car(motion: RoadMotion) -> bool:
    """Whether a vehicle ever accelerates by more than 9 m/s2 or changes that by more than 25 m/s3."""
    along, across = motion.a, motion.aq
    step_s = float(motion.times[1] - motion.times[0])
    jerk = np.hypot(slope(along, step_s), slope(across, step_s))
    return bool(np.hypot(along, across).max() > CAR_MPS2 or jerk.max() > CAR_MPS3)


_CROSSING = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.OVERTAKE)


def _events_of(
    around: Surroundings, track: Track, motion: RoadMotion, changes: Sequence[Event], settings: LabelSettings
) -> list[Event]:
    """All events of one vehicle, precedence settled."""
    swerves = EvasiveSwerve(settings.evasive_swerve).detect(
        motion, lambda time: threatened(around, track.vehicle, motion, time, settings.evasive_swerve.threat_ttc_s)
    )
    # The whole history of lane changes decides on an overtake, also those that a swerve takes in.
    left = Overtake(settings.overtake).detect(around, changes)
    right = [change for change in changes if change.intention is Intention.RIGHT_LANE_CHANGE]
    events = [*swerves, *outside(swerves, [*left, *right])]
    events += HardBrake(settings.hard_brake).detect(motion)
    events += HardAccel(settings.hard_accel).detect(motion)
    return events + Following(settings.following).detect(around, motion, events)


def outside(swerves: Sequence[Event], changes: Sequence[Event]) -> list[Event]:
    """The lane changes whose crossing does not lie within one of the swerves."""
    return [c for c in changes if not any(s.onset <= c.commit <= s.end for s in swerves)]


def threatened(around: Surroundings, vehicle: str, motion: RoadMotion, time: float, ttc_s: float) -> bool:
    """Whether a vehicle would reach the one ahead of it within `ttc_s` at the present speeds."""
    speed = float(np.interp(time, motion.times, motion.v))
    leader = around.leader(vehicle, time, ttc_s * speed)
    if leader is None:
        return False
    track = around.recording.tracks[leader.vehicle]
    closing = speed - float(track.speed[around.step(time) - track.first_step])
    return closing > 0 and leader.gap_m <= ttc_s * closing


def origin(recording: Recording, event: Event) -> Origin:
    """Provenance: `stimulated` when the vehicle was under command at any time from 1 s before onset to the end."""
    own = recording.commands_to.get(event.vehicle, [])
    return "stimulated" if any(c.start <= event.end and c.end >= event.onset - 1.0 for c in own) else "natural"
