"""Following: steady driving behind a leader, the benign state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from isacsim.settings import Settings
from labeling.intentions import Event, Intention
from labeling.road_motion import RoadMotion
from labeling.surroundings import Surroundings


class FollowingSettings(Settings):
    """What counts as following, and how densely such windows are taken."""

    headway_s: float = Field(3.0, gt=0.0, le=10.0, description="greatest gap to the leader over own speed, s")
    clear_s: float = Field(10.0, ge=0.0, le=60.0, description="no other event this long before and after, s")
    before_s: float = Field(2.6, ge=0.0, le=30.0, description="the leader is followed from this long before, s")
    after_s: float = Field(2.4, ge=0.0, le=30.0, description="until this long after, s")
    check_s: float = Field(0.5, gt=0.0, le=5.0, description="interval at which that is looked at, s")
    spacing_s: float = Field(10.0, gt=0.0, le=600.0, description="least time between two windows of one vehicle, s")


@dataclass(frozen=True)
class Following:
    """The vehicle keeps its lane behind one leader within `headway_s`, and nothing else happens for `clear_s` around.

    The leader is the same vehicle from `before_s` before to `after_s` after, always within `headway_s`. onset and
    commit: the instant around which this holds; end: `after_s` later. peak: the acceleration of greatest size
    meanwhile, m/s2.
    other: the leader. The vehicle has to be on the road for all of `clear_s` before and after: what happened before
    it was seen is not known.
    Fails where: the leader is in another lane (a zip merge), or is not in the recording.
    """

    settings: FollowingSettings

    def detect(self, around: Surroundings, motion: RoadMotion, others: Sequence[Event]) -> list[Event]:
        """The windows of one vehicle, at least `spacing_s` apart. others: all its other events."""
        s = self.settings
        found: list[Event] = []
        for start, stop in self._clear(motion, others):
            time = start
            while time <= stop:
                event = self._at(around, motion, time)
                if event is not None:
                    found.append(event)
                time += s.check_s if event is None else s.spacing_s
        return found

    def _clear(self, motion: RoadMotion, others: Sequence[Event]) -> list[tuple[float, float]]:
        """The stretches in which no other event, and no end of the track, is within `clear_s`."""
        clear = self.settings.clear_s
        start, stretches = float(motion.times[0]) + clear, []
        crossed = [(crossing.time, crossing.time) for crossing in motion.crossings]
        for onset, end in sorted([(event.onset, event.end) for event in others] + crossed):
            stretches.append((start, onset - clear))
            start = max(start, end + clear)
        stretches.append((start, float(motion.times[-1]) - clear))
        return [(a, b) for a, b in stretches if b >= a]

    def _at(self, around: Surroundings, motion: RoadMotion, time: float) -> Event | None:
        """The window around an instant, if it is one."""
        s = self.settings
        first = self._leader(around, motion, time)
        if first is None:
            return None
        checks = np.arange(time - s.before_s, time + s.after_s + s.check_s / 2, s.check_s)
        if any(self._leader(around, motion, float(t)) != first for t in checks):
            return None
        inside = motion.a[(motion.times >= checks[0]) & (motion.times <= checks[-1])]
        peak = float(inside[np.abs(inside).argmax()]) if len(inside) else 0.0
        return Event(motion.vehicle, Intention.FOLLOWING, time, time, time + s.after_s, peak, first)

    def _leader(self, around: Surroundings, motion: RoadMotion, time: float) -> str | None:
        """The vehicle followed at an instant within the headway."""
        within = self.settings.headway_s * float(np.interp(time, motion.times, motion.v))
        leader = around.leader(motion.vehicle, time, within)
        return None if leader is None else leader.vehicle
