"""A disturbance: a vehicle stops in its lane, stands, and drives on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import LARGEST_MPS3, sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling import vehicle_control as control
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate


class StopInLaneCommandSettings(Settings):
    """A disturbance: a vehicle stops in its lane, stands, and drives on."""

    stand_s: kinds.Durations = sourced(
        (15.0, 40.0), "time at a standstill, s", "chosen: others get past before a queue forms"
    )
    deceleration_mps2: float = sourced(
        2.5, "deceleration to a standstill, m/s2", "chosen: comfortable, no hard brake", ge=0.1, le=10.0
    )
    jerk_mps3: float = sourced(
        5.0, "jerk into and out of the deceleration, m/s3", "chosen: comfortable", ge=0.1, le=LARGEST_MPS3
    )


class StopsInLane(DirectorSettings):
    stop_in_lane_per_vehicle_hour: float = rate("vehicles that stop in their lane", 0.1)
    stop_in_lane: StopInLaneCommandSettings = StopInLaneCommandSettings()


@dataclass
class StopInLaneCommand(ManeuverCommand):
    """Stop, stand in the lane for `stand_s`, and drive on: an obstacle that others brake and swerve for."""

    vehicle: str
    stand_s: float
    settings: StopInLaneCommandSettings
    name = "stop_in_lane"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        speed = sumo.vehicle.getSpeed(self.vehicle)
        peak, jerk = self.settings.deceleration_mps2, self.settings.jerk_mps3
        profile = control.ramp_hold_ramp(-peak, jerk, speed / peak, jerk, step_s)
        yield from control.follow_profile(sumo, self.vehicle, profile, step_s, 0.0, np.inf)
        sumo.vehicle.setSpeed(self.vehicle, 0.0)
        yield from control.wait(self.stand_s, step_s)
        yield from control.release(sumo, self.vehicle, step_s)


def stopping_m(speed_mps: float, stop: StopInLaneCommandSettings) -> float:
    """Return the distance in which `StopInLaneCommand` comes to a standstill, m.

    v^2 / 2a, plus half of what is driven at full speed while the deceleration a rises.
    """
    peak, jerk = stop.deceleration_mps2, stop.jerk_mps3
    return speed_mps**2 / (2.0 * peak) + speed_mps * peak / (2.0 * jerk)


def draw(occasion: Occasion, settings: StopsInLane) -> StopInLaneCommand:
    """Return a stop."""
    stop = settings.stop_in_lane
    return StopInLaneCommand(occasion.view.vehicle, occasion.rng.uniform(*stop.stand_s), stop)


KIND = Kind("stop_in_lane", draw)
