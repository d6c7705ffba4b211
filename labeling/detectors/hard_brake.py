"""Hard braking."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from isacsim.settings import Settings
from labeling.detectors.threshold_crossings import surges
from labeling.intentions import Event, Intention
from labeling.road.road_motion import RoadMotion


class HardBrakeSettings(Settings):
    """What counts as hard. Telematics flags 0.25-0.45 g; UN R157 calls 5 m/s2 an emergency, AEB starts at 6."""

    threshold_mps2: float = Field(4.0, gt=0.0, le=12.0, description="least deceleration, m/s2")
    hold_s: float = Field(0.5, ge=0.0, le=10.0, description="how long it is held, s")
    rest_mps2: float = Field(0.5, ge=0.0, le=4.0, description="deceleration under which a driver is not braking, m/s2")
    trace_back_s: float = Field(3.0, gt=0.0, le=30.0, description="longest time from onset to commit, s")


@dataclass(frozen=True)
class HardBrake:
    """The vehicle decelerates by at least `threshold_mps2` for at least `hold_s` without a break.

    onset: the deceleration passes `rest_mps2`, traced back from the commit by at most `trace_back_s`.
    commit: it reaches the threshold. end: it is under `rest_mps2` again. peak: greatest deceleration, negative, m/s2.
    Fails where: a driver braked lightly for long before (the onset is then `trace_back_s` before the commit, not the
    first motion); braking below the threshold that a human would call hard on ice.
    """

    settings: HardBrakeSettings

    def detect(self, motion: RoadMotion) -> list[Event]:
        """The hard brakes of one vehicle, in order."""
        s = self.settings
        found = surges(motion.times, -motion.a, s.threshold_mps2, s.hold_s, s.rest_mps2, s.trace_back_s)
        return [Event(motion.vehicle, Intention.HARD_BRAKE, x.onset, x.commit, x.end, -x.peak) for x in found]
