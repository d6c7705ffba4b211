"""Following: steady driving behind a leader, the benign state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, floor

import numpy as np
from pydantic import Field

from isacsim.settings import Settings
from labeling.intentions import Event, Intention
from labeling.road.road_motion import RoadMotion
from labeling.road.surroundings import Surroundings


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
        """The windows of one vehicle, at least `spacing_s` apart. others: all its other events.

        Instants are whole multiples of `check_s`, so that all vehicles are looked at together.
        """
        s = self.settings
        first = _down(float(motion.times[0]) / s.check_s)
        checked = np.arange(first, _up(float(motion.times[-1]) / s.check_s) + 1)
        within = (s.headway_s * np.interp(checked * s.check_s, motion.times, motion.v)).tolist()

        @cache
        def leader(k: int) -> str | None:
            """The vehicle followed at an instant within the headway."""
            ahead = around.leader(motion.vehicle, k * s.check_s, within[k - first])
            return None if ahead is None else ahead.vehicle

        found: list[Event] = []
        earliest = -np.inf
        for start, stop in self._clear(motion, others):
            for k in range(_up(max(start, earliest) / s.check_s), _down(stop / s.check_s) + 1):
                time = k * s.check_s
                span = range(_up((time - s.before_s) / s.check_s), _down((time + s.after_s) / s.check_s) + 1)
                followed = leader(k) if time >= earliest else None
                if followed is not None and all(leader(j) == followed for j in span):
                    found.append(self._event(motion, time, followed))
                    earliest = time + s.spacing_s
        return found

    def _event(self, motion: RoadMotion, time: float, leader: str) -> Event:
        s = self.settings
        inside = motion.a[(motion.times >= time - s.before_s) & (motion.times <= time + s.after_s)]
        peak = float(inside[np.abs(inside).argmax()]) if len(inside) else 0.0
        return Event(motion.vehicle, Intention.FOLLOWING, time, time, time + s.after_s, peak, leader)

    def _clear(self, motion: RoadMotion, others: Sequence[Event]) -> list[tuple[float, float]]:
        """The stretches in which no other event, and no end of the track, is within `clear_s`."""
        # Room for the leader's check, also where the settings clear less than that.
        before, after = (
            max(self.settings.clear_s, self.settings.before_s),
            max(self.settings.clear_s, self.settings.after_s),
        )
        start, stretches = float(motion.times[0]) + before, []
        crossed = [(crossing.time, crossing.time) for crossing in motion.crossings]
        for onset, end in sorted([(event.onset, event.end) for event in others] + crossed):
            stretches.append((start, onset - after))
            start = max(start, end + before)
        stretches.append((start, float(motion.times[-1]) - after))
        return [(a, b) for a, b in stretches if b >= a]


def _up(ratio: float) -> int:
    """The next whole number, rounding errors aside."""
    return ceil(ratio - 1e-6)


def _down(ratio: float) -> int:
    return floor(ratio + 1e-6)
