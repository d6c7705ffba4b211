"""Evasive swerves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from isacsim.settings import Settings
from labeling.detectors.lane_change import moving_span
from labeling.detectors.threshold_crossings import last_below, spells
from labeling.intentions import Event, Intention
from labeling.road.road_motion import RoadMotion

Threat = Callable[[float], bool]
"""Whether something ahead threatens the vehicle at an instant, s."""


class EvasiveSwerveSettings(Settings):
    """What counts as evasive. Drivers swerve at 0.3-0.7 g; avoiding an obstacle takes 2.5-7 m/s2."""

    threshold_mps2: float = Field(3.0, gt=0.0, le=12.0, description="least lateral acceleration, m/s2")
    reversal_mps2: float = Field(1.5, gt=0.0, le=12.0, description="least lateral acceleration the other way, m/s2")
    reversal_s: float = Field(2.5, gt=0.0, le=10.0, description="longest time between the two peaks, s")
    aside_m: float = Field(0.4, gt=0.0, le=5.0, description="least distance moved aside, m")
    return_m: float = Field(0.8, ge=0.0, le=5.0, description="how near to where it left a vehicle has to come back, m")
    return_s: float = Field(5.0, gt=0.0, le=30.0, description="longest time from the lateral peak to the return, s")
    threat_ttc_s: float = Field(4.0, gt=0.0, le=20.0, description="time to collision that makes a leader a threat, s")
    motion_mps: float = Field(0.2, gt=0.0, le=2.0, description="lateral speed of the first motion, m/s")
    rest_mps2: float = Field(0.5, ge=0.0, le=4.0, description="lateral acceleration that is not yet the swerve's, m/s2")


@dataclass(frozen=True)
class EvasiveSwerve:
    """The vehicle jerks aside: a lateral acceleration of at least `threshold_mps2`, turned round within `reversal_s`.

    It moves at least `aside_m` aside, and either there is a threat ahead (a leader it would reach within `threat_ttc_s`
    at the present speeds) or it comes back to within `return_m` of where it left.
    onset: the lateral speed passes `motion_mps`, and the acceleration `rest_mps2`, traced back from its threshold;
    commit: the outward motion ends (the lateral peak); end: the return is complete, or the commit where there is none.
    peak: the first peak of lateral acceleration, m/s2, left positive.
    Fails where: what is evaded is no vehicle and the driver stays aside (no threat is seen); a racing driver's lane
    change.
    """

    settings: EvasiveSwerveSettings

    def detect(self, motion: RoadMotion, threatened: Threat) -> list[Event]:
        """The swerves of one vehicle, in order. threatened: asked at an onset, where the vehicle did not return."""
        s = self.settings
        peaks = [(start, stop, 1.0) for start, stop in spells(motion.times, motion.aq, s.threshold_mps2)]
        peaks += [(start, stop, -1.0) for start, stop in spells(motion.times, -motion.aq, s.threshold_mps2)]
        found: list[Event] = []
        for start, stop, sign in sorted(peaks):
            if found and start <= found[-1].end:
                continue
            event = self._swerve(motion, start, stop, sign, threatened)
            if event is not None:
                found.append(event)
        return found

    def _swerve(self, motion: RoadMotion, start: float, stop: float, sign: float, threatened: Threat) -> Event | None:
        """The swerve whose first peak of acceleration lies between start and stop, if it is one."""
        s = self.settings
        outward = (motion.times >= start) & (motion.times <= stop)
        back = (motion.times > stop) & (motion.times <= stop + s.reversal_s)
        if not outward.any() or not back.any() or (-sign * motion.aq[back]).max() < s.reversal_mps2:
            return None
        if any(start - 1.0 <= jump <= stop + 1.0 for jump in motion.jumps):
            return None
        onset, commit = moving_span(motion, sign, stop, s.motion_mps, 0.0)
        # A vehicle may be moving that way already, changing lanes: the swerve begins with its acceleration.
        onset = max(onset, last_below(motion.times, sign * motion.aq, s.rest_mps2, start) or onset)
        left_from = motion.lateral_at(onset)
        if sign * (motion.lateral_at(commit) - left_from) < s.aside_m:
            return None
        end = self._returned(motion, sign, commit, left_from)
        if end is None and not threatened(onset):
            return None
        peak = float(sign * (sign * motion.aq[outward]).max())
        return Event(motion.vehicle, Intention.EVASIVE_SWERVE, onset, commit, commit if end is None else end, peak)

    def _returned(self, motion: RoadMotion, sign: float, commit: float, left_from: float) -> float | None:
        """When the motion back ends that brings the vehicle to within `return_m`, s; None where there is none."""
        s = self.settings
        for start, stop in spells(motion.times, -sign * motion.vq, s.motion_mps):
            if commit <= start <= commit + s.return_s:
                back = (motion.times >= start) & (motion.times <= stop)
                if np.abs(motion.q[back] - left_from).min(initial=np.inf) <= s.return_m:
                    return stop
        return None
