"""Hard acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.detectors.threshold_crossings import excursions
from isac_cosim.labeling.intentions import Event, Intention


class HardAccelSettings(Settings):
    """Thresholds of a hard acceleration. Telematics flags 0.2 g; studies of driving style use up to 3.6 m/s2."""

    threshold_mps2: float = Field(2.5, gt=0.0, le=12.0, description="minimum acceleration, m/s2")
    hold_s: float = Field(1.0, ge=0.0, le=10.0, description="minimum time above the threshold, s")
    rest_mps2: float = Field(0.5, ge=0.0, le=4.0, description="acceleration below which the driver is cruising, m/s2")
    trace_back_s: float = Field(3.0, gt=0.0, le=30.0, description="maximum time from onset to commit, s")


@dataclass(frozen=True)
class HardAccelDetector:
    """Finds hard accelerations: the vehicle accelerates by at least `threshold_mps2` for at least `hold_s`.

    onset: the acceleration exceeds `rest_mps2`, traced back from the commit by at most `trace_back_s`.
    commit: it reaches `threshold_mps2`.
    end: it falls below `rest_mps2` again.
    peak: the strongest acceleration, m/s2.

    Fails where a brisk start from a traffic light is meant to be ordinary (it counts as hard), and where a gentle
    run-up hides the first motion (the onset is then `trace_back_s` before the commit).

    A vehicle accelerates from 15 to 24 m/s within three seconds:

    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> speeding_up = ScriptedVehicle("tv", speed=[(10, 15), (13, 24)])
    >>> [event] = HardAccelDetector(HardAccelSettings()).detect(vehicle_view(straight_road(speeding_up), "tv"))
    >>> event.intention.text, round(event.commit, 1), round(event.peak, 1)
    ('hard_accel', 10.1, 3.0)
    """

    settings_type: ClassVar[type[Settings]] = HardAccelSettings
    finds: ClassVar[tuple[Intention, ...]] = (Intention.HARD_ACCEL,)

    settings: HardAccelSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the hard accelerations of one vehicle, in order of onset."""
        s, motion = self.settings, view.motion
        surges = excursions(motion.times, motion.a, s.threshold_mps2, s.hold_s, s.rest_mps2, s.trace_back_s)
        return [Event(view.vehicle, Intention.HARD_ACCEL, e.onset, e.commit, e.end, e.peak) for e in surges]
