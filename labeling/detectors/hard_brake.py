"""Hard braking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.detectors.threshold_crossings import excursions
from isac_cosim.labeling.intentions import Event, Intention


class HardBrakeSettings(Settings):
    """Thresholds of a hard brake.

    Telematics flags 0.25-0.45 g, UN R157 calls 5 m/s2 an emergency, and automatic emergency braking starts at 6 m/s2.
    """

    threshold_mps2: float = Field(4.0, gt=0.0, le=12.0, description="minimum deceleration, m/s2")
    hold_s: float = Field(0.5, ge=0.0, le=10.0, description="minimum time above the threshold, s")
    rest_mps2: float = Field(
        0.5, ge=0.0, le=4.0, description="deceleration below which the driver is not braking, m/s2"
    )
    trace_back_s: float = Field(3.0, gt=0.0, le=30.0, description="maximum time from onset to commit, s")


@dataclass(frozen=True)
class HardBrakeDetector:
    """Finds hard brakes: the vehicle decelerates by at least `threshold_mps2` for at least `hold_s` without a break.

    onset: the deceleration exceeds `rest_mps2`, traced back from the commit by at most `trace_back_s`.
    commit: it reaches `threshold_mps2`.
    end: it falls below `rest_mps2` again; pumping the brake without such a rest is one event.
    peak: the strongest deceleration, m/s2, negative.

    Fails where the driver brakes lightly for a long time before (the onset is then `trace_back_s` before the commit,
    not the first motion), and on ice, where a human would call less than the threshold hard.

    A vehicle brakes from 30 to 18 m/s within two seconds:

    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> braking = ScriptedVehicle("tv", speed=[(10, 30), (12, 18)])
    >>> [brake] = HardBrakeDetector(HardBrakeSettings()).detect(vehicle_view(straight_road(braking), "tv"))
    >>> brake.intention.text, round(brake.commit, 1), round(brake.peak, 1)
    ('hard_brake', 10.1, -6.0)
    >>> stricter = HardBrakeSettings(threshold_mps2=7.0)
    >>> HardBrakeDetector(stricter).detect(vehicle_view(straight_road(braking), "tv"))
    []
    """

    settings_type: ClassVar[type[Settings]] = HardBrakeSettings
    finds: ClassVar[tuple[Intention, ...]] = (Intention.HARD_BRAKE,)

    settings: HardBrakeSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the hard brakes of one vehicle, in order of onset."""
        s, motion = self.settings, view.motion
        brakes = excursions(motion.times, -motion.a, s.threshold_mps2, s.hold_s, s.rest_mps2, s.trace_back_s)
        return [Event(view.vehicle, Intention.HARD_BRAKE, b.onset, b.commit, b.end, -b.peak) for b in brakes]
