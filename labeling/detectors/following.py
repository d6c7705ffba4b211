"""Following: steady driving behind a leader, the benign state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, floor
from typing import ClassVar

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import BoolArray
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.road_motion import RoadMotion


class FollowingSettings(Settings):
    """Thresholds of following, and how densely events are placed in it.

    before_s and after_s cover a record of 5 s with 2.6 s before the instant, wherever its random shift of up to 0.2 s
    moves it. lateral_mps is the lateral speed at which a lane change begins; acceleration_mps2 is half the deceleration
    of a hard brake.
    """

    headway_s: float = Field(3.0, gt=0.0, le=10.0, description="maximum gap to the leader divided by the speed, s")
    clear_s: float = Field(10.0, ge=0.0, le=60.0, description="no other event for this long before and after, s")
    before_s: float = Field(2.8, ge=0.0, le=30.0, description="the leader is followed from this long before, s")
    after_s: float = Field(2.6, ge=0.0, le=30.0, description="the leader is followed until this long after, s")
    lateral_mps: float | None = Field(
        0.2, gt=0.0, le=5.0, description="maximum lateral speed meanwhile, m/s; null: any lateral speed"
    )
    acceleration_mps2: float | None = Field(
        2.0, gt=0.0, le=12.0, description="maximum acceleration or deceleration meanwhile, m/s2; null: any acceleration"
    )
    check_s: float = Field(0.5, gt=0.0, le=5.0, description="interval at which the leader is checked, s")
    spacing_s: float = Field(10.0, gt=0.0, le=600.0, description="minimum time between two events of one vehicle, s")


@dataclass(frozen=True)
class FollowingDetector:
    """Finds following: the vehicle keeps its lane behind one leader, and nothing else happens around that time.

    The leader is the same vehicle from `before_s` before an instant to `after_s` after it, always ahead and within
    `headway_s`. A vehicle that stands follows nobody.
    For that time the vehicle moves across its lane at no more than `lateral_mps`, and neither speeds up nor slows down
    by more than `acceleration_mps2`. No other event of the vehicle and no crossing of a marking lies within `clear_s`,
    and the vehicle is on the road for all of that time, because what it did before it was seen is not known.

    onset, commit: the instant. end: `after_s` later.
    peak: the acceleration of largest magnitude meanwhile, m/s2.
    other: the leader.

    Fails where the leader is in another lane (a zip merge), and where it is missing from the recording.

    A vehicle follows another one at 30 m/s, 55 m behind:

    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> recording = straight_road(ScriptedVehicle("tv"), ScriptedVehicle("uv", start_m=60.0))
    >>> events = FollowingDetector(FollowingSettings()).detect(vehicle_view(recording, "tv"))
    >>> [(event.onset, event.other) for event in events]
    [(10.0, 'uv'), (20.0, 'uv'), (30.0, 'uv')]
    """

    settings_type: ClassVar[type[Settings]] = FollowingSettings
    finds: ClassVar[tuple[Intention, ...]] = (Intention.FOLLOWING,)

    settings: FollowingSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the events of one vehicle, at least `spacing_s` apart.

        Instants are whole multiples of `check_s`, so that the surroundings of all vehicles are evaluated at the same
        steps.
        """
        s, motion = self.settings, view.motion
        first = _round_down(float(motion.times[0]) / s.check_s)
        checks = np.arange(first, _round_up(float(motion.times[-1]) / s.check_s) + 1)
        within_m = (s.headway_s * np.interp(checks * s.check_s, motion.times, motion.v)).tolist()

        @cache
        def leader_at(k: int) -> str | None:
            """Return the vehicle within the headway at check k; one that stands alongside is not ahead."""
            leader = view.surroundings.leader(view.vehicle, k * s.check_s, within_m[k - first])
            return None if leader is None or leader.gap_m <= 0.0 else leader.vehicle

        hasty = np.concatenate([[0], np.cumsum(self._is_hasty(motion))]).tolist()
        begins = np.searchsorted(motion.times, checks * s.check_s - s.before_s).tolist()
        ends = np.searchsorted(motion.times, checks * s.check_s + s.after_s, side="right").tolist()

        def is_steady(k: int) -> bool:
            """Return whether the vehicle is never hasty in the time that an event at check k stands for."""
            return bool(hasty[begins[k - first]] == hasty[ends[k - first]])

        events: list[Event] = []
        earliest = -np.inf
        for start, stop in self._clear_intervals(motion, view.events):
            for k in range(_round_up(max(start, earliest) / s.check_s), _round_down(stop / s.check_s) + 1):
                time = k * s.check_s
                if time < earliest or not is_steady(k) or (leader := leader_at(k)) is None:
                    continue
                span = range(
                    _round_up((time - s.before_s) / s.check_s), _round_down((time + s.after_s) / s.check_s) + 1
                )
                if all(leader_at(j) == leader for j in span):
                    events.append(self._event(motion, time, leader))
                    earliest = time + s.spacing_s
        return events

    def _during(self, motion: RoadMotion, time: float) -> BoolArray:
        """Return which samples of the motion lie in the time that an event at an instant `time` (s) stands for."""
        return np.asarray(
            (motion.times >= time - self.settings.before_s) & (motion.times <= time + self.settings.after_s)
        )

    def _is_hasty(self, motion: RoadMotion) -> BoolArray:
        """Return at which samples the vehicle moves across its lane or changes its speed too fast, shape (n,)."""
        limits = ((motion.vq, self.settings.lateral_mps), (motion.a, self.settings.acceleration_mps2))
        hasty = np.zeros(len(motion.times), bool)
        for values, limit in limits:
            if limit is not None:
                hasty |= np.abs(values) > limit
        return hasty

    def _event(self, motion: RoadMotion, time: float, leader: str) -> Event:
        s = self.settings
        during = motion.a[self._during(motion, time)]
        peak = float(during[np.abs(during).argmax()]) if len(during) else 0.0
        return Event(motion.vehicle, Intention.FOLLOWING, time, time, time + s.after_s, peak, leader)

    def _clear_intervals(self, motion: RoadMotion, events: Sequence[Event]) -> list[tuple[float, float]]:
        """Return the intervals in which no other event, and no end of the track, is within `clear_s`."""
        s = self.settings
        # The leader is checked over before_s and after_s even where clear_s is shorter.
        before, after = max(s.clear_s, s.before_s), max(s.clear_s, s.after_s)
        start, intervals = float(motion.times[0]) + before, []
        crossings = [(crossing.time, crossing.time) for crossing in motion.crossings]
        for onset, end in sorted([(event.onset, event.end) for event in events] + crossings):
            intervals.append((start, onset - after))
            start = max(start, end + before)
        intervals.append((start, float(motion.times[-1]) - after))
        return [(start, stop) for start, stop in intervals if stop >= start]


def _round_up(ratio: float) -> int:
    """Round up to a whole number, tolerating rounding errors."""
    return ceil(ratio - 1e-6)


def _round_down(ratio: float) -> int:
    """Round down to a whole number, tolerating rounding errors."""
    return floor(ratio + 1e-6)
