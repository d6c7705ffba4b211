"""Hard acceleration."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from isacsim.settings import Settings
from labeling.detectors.threshold_crossings import surges
from labeling.intentions import Event, Intention
from labeling.road.road_motion import RoadMotion


class HardAccelSettings(Settings):
    """What counts as hard. Telematics flags 0.2 g; other studies ask for up to 3.6 m/s2."""

    threshold_mps2: float = Field(2.5, gt=0.0, le=12.0, description="least acceleration, m/s2")
    hold_s: float = Field(1.0, ge=0.0, le=10.0, description="how long it is held, s")
    rest_mps2: float = Field(0.5, ge=0.0, le=4.0, description="acceleration under which a driver is cruising, m/s2")
    trace_back_s: float = Field(3.0, gt=0.0, le=30.0, description="longest time from onset to commit, s")


@dataclass(frozen=True)
class HardAccel:
    """The vehicle accelerates by at least `threshold_mps2` for at least `hold_s` without a break.

    onset: the acceleration passes `rest_mps2`, traced back from the commit by at most `trace_back_s`.
    commit: it reaches the threshold. end: it is under `rest_mps2` again. peak: greatest acceleration, m/s2.
    Fails where: a brisk start from a traffic light is meant to be ordinary (it counts here); a gentle run-up hides the
    first motion (the onset is then `trace_back_s` before the commit).
    """

    settings: HardAccelSettings

    def detect(self, motion: RoadMotion) -> list[Event]:
        """The hard accelerations of one vehicle, in order."""
        s = self.settings
        found = surges(motion.times, motion.a, s.threshold_mps2, s.hold_s, s.rest_mps2, s.trace_back_s)
        return [Event(motion.vehicle, Intention.HARD_ACCEL, x.onset, x.commit, x.end, x.peak) for x in found]
