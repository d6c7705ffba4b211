"""Overtakes: what a lane change to the faster side was for, judged by what followed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.intentions import Event, Intention, outward
from isac_cosim.labeling.road.surroundings import Surroundings

Verdict = Literal["overtaken", "not_passed", "passed_did_not_return", "unresolved"]

Judged = Literal["horizon", "track", "never"]
"""By what a pull-out is judged: what follows within the horizon, what is seen of it, or not at all."""

SAMPLE_S = 0.1
"""Interval at which the gap between two vehicles is sampled, s."""


class OvertakeSettings(Settings):
    """Thresholds of an overtake: pull out, pass, return."""

    horizon_s: float = Field(
        30.0, gt=0.0, le=300.0, description="maximum time from the onset of pulling out to the return, s"
    )
    before_onset_s: float = Field(
        1.0, ge=0.0, le=10.0, description="how long before onset the vehicle ahead is looked up, s"
    )
    judged: Judged = Field(
        "horizon",
        description="horizon: a pull-out whose track ends before the horizon is unresolved, unless it returned; track: "
        "it is what it was when its track ended; never: every pull-out is a lane change, and there is no overtake",
    )
    look_ahead_m: float = Field(100.0, gt=0.0, le=500.0, description="maximum gap to the vehicle ahead, m")


@dataclass(frozen=True)
class PullOutOutcome:
    """What a lane change to the faster side meant for another vehicle.

    returned: when the overtaking vehicle is back ahead of it, s; None without an overtake.
    """

    verdict: Verdict
    returned: float | None = None


@dataclass(frozen=True)
class OvertakeDetector:
    """Finds overtakes: the vehicle pulls out to the faster side, its rear passes the other's front, and it returns.

    The faster side is the left, or the right where traffic keeps left (`Recording.lefthand`). The return is within
    `horizon_s` of the onset of pulling out, and crosses as many markings back as were crossed outward since. The other
    vehicle is ahead when the pulling-out begins. An overtake is about a pair: the same lane change can overtake one
    vehicle and not another. `detect` judges it for the vehicle ahead in the lane that is left, within `look_ahead_m`;
    `labeling.samples.candidates` asks again for the UV of each sample.

    onset, commit, peak: those of the pulling-out.
    end: the returning vehicle's centre crosses back. motion_end: the end of the pulling-out.

    Every other change to the faster side stays one. It carries a mark, and becomes no sample, where the other vehicle
    was passed without a return within `horizon_s` (`passed_did_not_return`), and where the vehicle left the road or the
    recording ended within `horizon_s` with the outcome open (`unresolved`). Where all tracks are shorter than that, as
    in recordings by drones, `judged` keeps more of them: see `OvertakeSettings`. An overtake whose return is not seen
    is then a lane change, or `passed_did_not_return`.

    Fails where the other vehicle turns off before it is passed (it counts as not passed), and where the passing is done
    in the oncoming lane, which belongs to another edge. Passing on the slower side is no overtake.

    A vehicle pulls out at 10 s, passes a slower one, and returns at 24 s:

    >>> from dataclasses import replace
    >>> from isac_cosim.labeling.detectors.lane_change import LaneChangeDetector, LaneChangeSettings
    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> fast = ScriptedVehicle("tv", speed=32.0, lateral=[(10, 0.0), (14, 3.2), (24, 3.2), (28, 0.0)])
    >>> slow = ScriptedVehicle("uv", speed=24.0, start_m=120.0)
    >>> view = vehicle_view(straight_road(fast, slow), "tv")
    >>> lane_changes = LaneChangeDetector(LaneChangeSettings()).detect(view)
    >>> [overtake] = OvertakeDetector(OvertakeSettings()).detect(replace(view, lane_changes=tuple(lane_changes)))
    >>> overtake.intention.text, overtake.other, round(overtake.commit, 1), round(overtake.end, 1)
    ('overtake', 'uv', 12.0, 26.0)
    """

    settings_type: ClassVar[type[Settings]] = OvertakeSettings
    finds: ClassVar[tuple[Intention, ...]] = (Intention.OVERTAKE,)

    settings: OvertakeSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return one event for each change to the faster side: an overtake, or the lane change with its mark."""
        events = []
        change_out = outward(view.surroundings.recording.lefthand)
        for change in view.lane_changes:
            if change.intention is change_out:
                other = self.vehicle_ahead(view.surroundings, change)
                outcome = PullOutOutcome("not_passed")
                if other is not None:
                    outcome = self.outcome(view.surroundings, view.lane_changes, change, other)
                events.append(self.judged(change, other, outcome))
        return events

    def judged(self, change: Event, other: str | None, outcome: PullOutOutcome) -> Event:
        """Return a lane change to the faster side as what it turned out to be for another vehicle."""
        if outcome.verdict == "overtaken" and outcome.returned is not None:
            return replace(
                change, intention=Intention.OVERTAKE, end=outcome.returned, motion_end=change.end, other=other
            )
        return change if outcome.verdict == "not_passed" else replace(change, mark=outcome.verdict, other=other)

    def vehicle_ahead(self, surroundings: Surroundings, change: Event) -> str | None:
        """Return the vehicle ahead in the lane that a lane change leaves, or None if there is none."""
        time = change.onset - self.settings.before_onset_s
        if not surroundings.has(change.vehicle, time, change.commit):
            time = change.onset
        leader = surroundings.leader(change.vehicle, time, self.settings.look_ahead_m)
        return None if leader is None else leader.vehicle

    def outcome(
        self, surroundings: Surroundings, changes: Sequence[Event], change: Event, other: str
    ) -> PullOutOutcome:
        """Return what one lane change to the faster side meant for another vehicle.

        changes: all completed lane changes of the changing vehicle, in order of crossing.
        """
        if self.settings.judged == "never":
            return PullOutOutcome("not_passed")
        track = surroundings.recording.tracks[change.vehicle]
        last_seen = float(surroundings.recording.times(track)[-1])
        horizon = change.onset + self.settings.horizon_s
        return_time = _return_time(changes, change)
        until = min(horizon, last_seen) if return_time is None else min(horizon, last_seen, return_time)
        passed = _passes(surroundings, change, other, until)
        if return_time is not None and return_time <= horizon:
            return PullOutOutcome("overtaken", return_time) if passed else PullOutOutcome("not_passed")
        if last_seen < horizon and self.settings.judged == "horizon":
            return PullOutOutcome("unresolved")
        return PullOutOutcome("passed_did_not_return" if passed else "not_passed")


def _return_time(changes: Sequence[Event], change: Event) -> float | None:
    """Return when the vehicle has crossed back as many markings as it crossed from this change on, s."""
    markings_out = 0
    for later in changes:
        if later.commit >= change.commit:
            markings_out += 1 if later.intention is change.intention else -1
            if markings_out <= 0:
                return later.commit
    return None


def _passes(surroundings: Surroundings, change: Event, other: str, until: float) -> bool:
    """Return whether another vehicle is ahead at onset, and behind this one's rear when last seen up to `until`, s."""
    length = surroundings.recording.tracks[change.vehicle].length_m
    times = np.append(np.arange(change.onset, until, SAMPLE_S), until)
    gaps = surroundings.gaps(change.vehicle, other, times)
    seen = gaps[~np.isnan(gaps)]
    return bool(len(seen) and not np.isnan(gaps[0]) and gaps[0] > 0 and seen[-1] < -length)
