"""A brake is any deceleration above a threshold, however short."""

from dataclasses import dataclass

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.threshold_crossings import intervals_above
from isac_cosim.labeling.intentions import Event, Intention


class GentleBrakeSettings(Settings):
    threshold_mps2: float = Field(2.0, gt=0, description="minimum deceleration, m/s2")


@dataclass(frozen=True)
class GentleBrake:
    """Every deceleration above `threshold_mps2`; onset and commit are where it is first exceeded."""

    settings_type = GentleBrakeSettings
    finds = (Intention.HARD_BRAKE,)
    settings: GentleBrakeSettings

    def detect(self, view):
        deceleration = -view.motion.a
        return [
            Event(view.vehicle, Intention.HARD_BRAKE, begin, begin, end, peak=-deceleration.max())
            for begin, end in intervals_above(view.motion.times, deceleration, self.settings.threshold_mps2)
        ]
