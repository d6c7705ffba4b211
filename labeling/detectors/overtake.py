"""Overtakes: what a left lane change was for, seen from what followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from isacsim.settings import Settings
from labeling.intentions import Event, Intention
from labeling.road.surroundings import Surroundings

Verdict = Literal["overtaken", "not_passed", "passed_did_not_return", "unresolved"]

SAMPLE_S = 0.1
"""Interval at which the gap between two vehicles is looked at, s."""


class OvertakeSettings(Settings):
    """What counts as one: divert, pass, return."""

    horizon_s: float = Field(
        30.0, gt=0.0, le=300.0, description="longest time from the pulling-out's onset to the return, s"
    )
    before_onset_s: float = Field(
        1.0, ge=0.0, le=10.0, description="when the vehicle ahead is looked up, before onset, s"
    )
    look_ahead_m: float = Field(100.0, gt=0.0, le=500.0, description="how far ahead, m")


@dataclass(frozen=True)
class Outcome:
    """What a left change meant for another vehicle. returned: when the overtaking one is back ahead of it, s."""

    verdict: Verdict
    returned: float | None = None


@dataclass(frozen=True)
class Overtake:
    """The vehicle changes left, its rear passes the other's front, and it changes right, back ahead of the other.

    All within `horizon_s` of the pulling-out's onset. It is about the pair: the same left change can overtake one
    vehicle and not another. The other is ahead when the pulling-out begins. Back means over as many markings to the
    right as there were crossed to the left since.
    onset, commit, peak: the pulling-out's. end: the returning vehicle's centre crosses back; motion_end: the
    pulling-out's end. Verdicts otherwise: `not_passed` a plain left lane change (it returned without having passed, or
    had not passed within the horizon); `passed_did_not_return`; `unresolved` (the vehicle left the road or the
    recording ended within the horizon, with neither known).
    Fails where: the other turns off unpassed (not passed); the passing is done on a road's oncoming lane.
    """

    settings: OvertakeSettings

    def detect(self, around: Surroundings, changes: Sequence[Event]) -> list[Event]:
        """The left changes among the completed lane changes of one vehicle, told apart by the vehicle ahead of them.

        changes: all completed lane changes of the vehicle, in order. Returns one event a left change: an overtake, or
        the left change with its mark.
        """
        found = []
        for change in changes:
            if change.intention is Intention.LEFT_LANE_CHANGE:
                other = self.ahead(around, change)
                outcome = Outcome("not_passed") if other is None else self.outcome(around, changes, change, other)
                found.append(self.judged(change, other, outcome))
        return found

    def judged(self, change: Event, other: str | None, outcome: Outcome) -> Event:
        """A left change as what it turned out to be."""
        if outcome.verdict == "overtaken" and outcome.returned is not None:
            return replace(
                change, intention=Intention.OVERTAKE, end=outcome.returned, motion_end=change.end, other=other
            )
        return change if outcome.verdict == "not_passed" else replace(change, mark=outcome.verdict, other=other)

    def ahead(self, around: Surroundings, change: Event) -> str | None:
        """The vehicle ahead in the lane that a change leaves."""
        time = change.onset - self.settings.before_onset_s
        if not around.has(change.vehicle, time, change.commit):
            time = change.onset
        leader = around.leader(change.vehicle, time, self.settings.look_ahead_m)
        return None if leader is None else leader.vehicle

    def outcome(self, around: Surroundings, changes: Sequence[Event], change: Event, other: str) -> Outcome:
        """What one left change meant for another vehicle.

        changes: all completed lane changes of the changing vehicle, in order.
        """
        track = around.recording.tracks[change.vehicle]
        last = float(around.recording.times(track)[-1])
        horizon = change.onset + self.settings.horizon_s
        back = self._back(changes, change)
        returned = back is not None and back <= horizon
        until = min(horizon, last) if back is None else min(horizon, last, back)
        passed = self._passes(around, change, other, until)
        if returned:
            return Outcome("overtaken", back) if passed else Outcome("not_passed")
        if last < horizon:
            return Outcome("unresolved")
        return Outcome("passed_did_not_return" if passed else "not_passed")

    def _back(self, changes: Sequence[Event], change: Event) -> float | None:
        """When the vehicle is back across as many markings as it crossed from this change on, s."""
        level = 0
        for later in changes:
            if later.commit >= change.commit:
                level += 1 if later.intention is Intention.LEFT_LANE_CHANGE else -1
                if level <= 0:
                    return later.commit
        return None

    def _passes(self, around: Surroundings, change: Event, other: str, until: float) -> bool:
        """Whether the other was ahead at the onset and is behind the vehicle's rear when last seen up to an instant."""
        length = around.recording.tracks[change.vehicle].length_m
        times = np.append(np.arange(change.onset, until, SAMPLE_S), until)
        gaps = around.gaps(change.vehicle, other, times)
        seen = gaps[~np.isnan(gaps)]
        return bool(len(seen) and not np.isnan(gaps[0]) and gaps[0] > 0 and seen[-1] < -length)
