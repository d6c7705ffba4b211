"""The settings of the closed loop."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from isac_cosim.base.setting_fields import Range, range_within
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.sensing.onboard_radar import RadarSettings
from isac_cosim.isacsim.sensing.running.conditioning import Conditioning
from isac_cosim.isacsim.sensing.sensors import DEFAULT, SENSORS

Arm = str
"""What happens on an alarm, and where the alarm comes from: an arm of `ARMS`, or advisories on alarms by any sensor."""
ARMS: dict[Arm, str] = {
    "none": "nothing is sensed or sent",
    "placebo": "alarms by ISAC sensing; nothing is sent",
    "random": "advisories on alarms drawn at random, as often as ISAC raised them in the open loop",
    "radar": "advisories on alarms by the onboard radar of the UV",
    "isac": "advisories on alarms by ISAC sensing",
    "truth": "advisories on alarms by the true motion of the TV",
}
"""What the arms are, in the order in which they are shown. Arms of other sensors follow."""
NOT_OF_A_SENSOR: tuple[Arm, ...] = ("none", "placebo", "random")
"""Arms that are not named after a sensor; those that sense use the sensor of the open loop."""
BY_ANOTHER = {
    "placebo": "alarms by {}; nothing is sent",
    "random": "advisories on alarms drawn at random, as often as {} raised them in the open loop",
}
"""What arms are where the open loop has another sensor than the sites."""


def what(arm: Arm, sensor: str = DEFAULT) -> str:
    """Return what an arm is. sensor: of the open loop."""
    if arm in ARMS and (arm not in BY_ANOTHER or sensor == DEFAULT):
        return ARMS[arm]
    label = SENSORS[sensor if arm in BY_ANOTHER else arm].label
    return BY_ANOTHER.get(arm, "advisories on alarms by {}").format(label)


def _known(arm: Arm) -> Arm:
    if arm not in ARMS and arm not in SENSORS:
        raise ValueError(f"unknown arm {arm!r}: choose among {', '.join(dict.fromkeys([*ARMS, *SENSORS]))}")
    return arm


class AdvisorySettings(Settings):
    """What an advisory asks for, and how it reaches the road.

    Speeds change with a limited jerk. The driver keeps its distance all the while, and the driver's own reactions to
    what happens ahead end an advisory at once.
    """

    network_delay_s: float = Field(0.1, ge=0.0, le=10.0, description="from the alarm to its display in the vehicle, s")
    reaction_s: Annotated[Range, range_within(0.0, 10.0)] = Field(
        (0.6, 1.6), description="from the display to the driver's first motion, s; 0 to 0: the vehicle obeys by itself"
    )
    compliance: float = Field(1.0, ge=0.0, le=1.0, description="share of advisories that drivers follow")
    range_m: float = Field(100.0, gt=0.0, le=500.0, description="a vehicle farther from the TV gets no advisory, m")
    gentle_mps2: float = Field(1.0, gt=0.0, le=4.0, description="deceleration of `open_gap`, m/s2")
    firm_mps2: float = Field(2.0, gt=0.0, le=4.0, description="deceleration of `slow`, m/s2")
    jerk_mps3: float = Field(2.0, gt=0.0, le=10.0, description="how fast that deceleration builds up, m/s3")
    open_gap_mps: float = Field(2.0, gt=0.0, le=20.0, description="how much slower `open_gap` gets, m/s")
    slow_mps: float = Field(4.0, gt=0.0, le=20.0, description="how much slower `slow` gets, m/s")
    least_share: float = Field(0.6, gt=0.0, le=1.0, description="no slower than this share of the speed at its start")
    hold_s: float = Field(3.0, ge=0.0, le=60.0, description="how long the lower speed is held, s")
    hold_lane_s: float = Field(6.0, gt=0.0, le=60.0, description="how long `hold_lane` lasts, s")
    rest_s: float = Field(6.0, ge=0.0, le=1e5, description="pause between two advisories to one vehicle, s")


class ClosedLoopSettings(Settings):
    """The closed loop: arms on the same seeds.

    conditioning: how running traffic becomes the sensed world (`isacsim.sensing.running.conditioning`).
    radar: of the arm of that name, unless the open loop has the radar as its sensor; then it is the same one.
    near_m, after_s: what is scored: the vehicles within this distance of the TV at an alarm of the placebo arm, for
    this long after it, m and s.
    """

    arms: tuple[Annotated[Arm, AfterValidator(_known)], ...] = Field(tuple(ARMS), min_length=1)
    conditioning: Conditioning = "trailing"
    advisories: AdvisorySettings = AdvisorySettings()
    radar: RadarSettings = RadarSettings()
    near_m: float = Field(150.0, gt=0.0, le=2000.0)
    after_s: float = Field(20.0, gt=0.0, le=300.0)
