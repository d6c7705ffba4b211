"""Evasive swerves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.lane_change import moving_span
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.detectors.threshold_crossings import intervals_above, last_below
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.road_motion import RoadMotion


class EvasiveSwerveSettings(Settings):
    """Thresholds of an evasive swerve. Drivers swerve at 0.3-0.7 g; avoiding an obstacle takes 2.5-7 m/s2."""

    threshold_mps2: float = Field(3.0, gt=0.0, le=12.0, description="minimum lateral acceleration, m/s2")
    reversal_mps2: float = Field(
        1.5, gt=0.0, le=12.0, description="minimum lateral acceleration to the other side, m/s2"
    )
    reversal_s: float = Field(2.5, gt=0.0, le=10.0, description="maximum time between the two peaks, s")
    aside_m: float = Field(0.4, gt=0.0, le=5.0, description="minimum distance moved aside, m")
    return_m: float = Field(
        0.8, ge=0.0, le=5.0, description="maximum distance from the former lateral position after a return, m"
    )
    return_s: float = Field(5.0, gt=0.0, le=30.0, description="maximum time from the lateral peak to the return, s")
    threat_ttc_s: float = Field(
        4.0, gt=0.0, le=20.0, description="time to collision up to which a leader is a threat, s"
    )
    motion_mps: float = Field(0.2, gt=0.0, le=2.0, description="lateral speed of the first motion, m/s")
    rest_mps2: float = Field(
        0.5, ge=0.0, le=4.0, description="lateral acceleration below which the swerve has not begun, m/s2"
    )


@dataclass(frozen=True)
class EvasiveSwerveDetector:
    """Finds evasive swerves: the vehicle jerks aside, and either returns or had a threat ahead.

    Its lateral acceleration reaches `threshold_mps2` and, within `reversal_s`, `reversal_mps2` to the other side. It
    moves at least `aside_m` aside. It then comes back to within `return_m` of its former lateral position, starting
    within `return_s`; or there is a threat ahead at the onset, a leader that it would reach within `threat_ttc_s` at
    the present speeds.

    onset: the lateral speed exceeds `motion_mps` and the lateral acceleration `rest_mps2`, traced back from the
    threshold.
    commit: the motion aside ends, at the lateral peak.
    end: the motion back ends; the commit where there is none.
    peak: the first peak of the lateral acceleration, m/s2, left positive.

    Fails where the driver evades something other than a vehicle and stays aside (no threat is seen), and where a driver
    changes lanes as sharply as in a race.

    A vehicle jerks 1.2 m aside and comes back:

    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> evading = ScriptedVehicle("tv", lateral=[(10, 0.0), (10.8, 1.2), (12, 1.2), (12.8, 0.0)])
    >>> view = vehicle_view(straight_road(evading), "tv")
    >>> [swerve] = EvasiveSwerveDetector(EvasiveSwerveSettings()).detect(view)
    >>> swerve.intention.text, round(swerve.commit, 1), round(swerve.end, 1), round(swerve.peak, 1)
    ('evasive_swerve', 11.0, 13.0, 4.0)
    """

    settings_type: ClassVar[type[Settings]] = EvasiveSwerveSettings
    finds: ClassVar[tuple[Intention, ...]] = (Intention.EVASIVE_SWERVE,)

    settings: EvasiveSwerveSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the swerves of one vehicle, in order of onset."""
        motion, threshold = view.motion, self.settings.threshold_mps2
        peaks = [(start, stop, 1.0) for start, stop in intervals_above(motion.times, motion.aq, threshold)]
        peaks += [(start, stop, -1.0) for start, stop in intervals_above(motion.times, -motion.aq, threshold)]
        swerves: list[Event] = []
        for start, stop, sign in sorted(peaks):
            if swerves and start <= swerves[-1].end:
                continue
            swerve = self._swerve(view, start, stop, sign)
            if swerve is not None:
                swerves.append(swerve)
        return swerves

    def _swerve(self, view: VehicleView, start: float, stop: float, sign: float) -> Event | None:
        """Return the swerve whose first peak of acceleration lies between start and stop, s, if it is one."""
        s, motion = self.settings, view.motion
        outward = (motion.times >= start) & (motion.times <= stop)
        reversal = (motion.times > stop) & (motion.times <= stop + s.reversal_s)
        if not outward.any() or not reversal.any() or (-sign * motion.aq[reversal]).max() < s.reversal_mps2:
            return None
        if any(start - 1.0 <= jump <= stop + 1.0 for jump in motion.jumps):
            return None
        onset, commit = moving_span(motion, sign, stop, s.motion_mps, 0.0)
        # The vehicle may already be moving to that side in a lane change: the swerve begins with its acceleration.
        onset = max(onset, last_below(motion.times, sign * motion.aq, s.rest_mps2, start) or onset)
        former_m = motion.lateral_at(onset)
        if sign * (motion.lateral_at(commit) - former_m) < s.aside_m:
            return None
        end = self._return_end(motion, sign, commit, former_m)
        if end is None and not is_threatened(view, onset, s.threat_ttc_s):
            return None
        peak = float(sign * (sign * motion.aq[outward]).max())
        return Event(view.vehicle, Intention.EVASIVE_SWERVE, onset, commit, commit if end is None else end, peak)

    def _return_end(self, motion: RoadMotion, sign: float, commit: float, former_m: float) -> float | None:
        """Return when the motion back to within `return_m` of the former position ends, s, or None without a return."""
        s = self.settings
        for start, stop in intervals_above(motion.times, -sign * motion.vq, s.motion_mps):
            if commit <= start <= commit + s.return_s:
                back = (motion.times >= start) & (motion.times <= stop)
                if np.abs(motion.q[back] - former_m).min(initial=np.inf) <= s.return_m:
                    return stop
        return None


def is_threatened(view: VehicleView, time: float, ttc_s: float) -> bool:
    """Return whether a vehicle would reach its leader within `ttc_s` at the speeds of an instant `time`, s."""
    surroundings = view.surroundings
    speed = float(np.interp(time, view.motion.times, view.motion.v))
    leader = surroundings.leader(view.vehicle, time, ttc_s * speed)
    if leader is None:
        return False
    track = surroundings.recording.tracks[leader.vehicle]
    closing = speed - float(track.speed[surroundings.step(time) - track.first_step])
    return closing > 0 and leader.gap_m <= ttc_s * closing
