"""A disturbance: a vehicle slows down gently and stays slow for a while."""

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


class SlowVehicleCommandSettings(Settings):
    """A disturbance: a vehicle slows down gently and stays slow for a while."""

    least_speed_mps: kinds.Speed = sourced(
        15.0, "only faster vehicles slow down, m/s", "chosen: slower ones disturb already"
    )
    speed_share: kinds.Shares = sourced(
        (0.65, 0.8), "speed while slow, as a share of the speed before", "measured: others overtake vehicles this slow"
    )
    slow_s: kinds.Durations = sourced(
        (20.0, 40.0), "time at that speed, s", "chosen: longer than an overtake of 10 to 20 s"
    )
    deceleration_mps2: float = sourced(1.0, "deceleration, m/s2", "chosen: far from a hard brake", ge=0.1, le=10.0)
    jerk_mps3: float = sourced(
        1.0, "jerk into and out of the deceleration, m/s3", "chosen: gentle", ge=0.1, le=LARGEST_MPS3
    )
    recover_s: kinds.Duration = sourced(8.0, "time over which the desired speed comes back, s", "chosen: gentle")


class SlowVehicles(DirectorSettings):
    slow_vehicle_per_vehicle_hour: float = rate("vehicles that slow down, for others to react to", 1.0)
    slow_vehicle: SlowVehicleCommandSettings = SlowVehicleCommandSettings()


@dataclass
class SlowVehicleCommand(ManeuverCommand):
    """Drive at `speed_share` of the present speed for `slow_s`: a disturbance that others react to."""

    vehicle: str
    speed_share: float
    slow_s: float
    settings: SlowVehicleCommandSettings
    name = "slow_vehicle"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        factor = sumo.vehicle.getSpeedFactor(self.vehicle)
        speed = sumo.vehicle.getSpeed(self.vehicle)
        peak, jerk = self.settings.deceleration_mps2, self.settings.jerk_mps3
        # The ramps together take away peak^2 / jerk of the speed, the hold the rest.
        hold_s = max(0.0, (1.0 - self.speed_share) * speed / peak - peak / jerk)
        profile = control.ramp_hold_ramp(-peak, jerk, hold_s, jerk, step_s)
        yield from control.follow_profile(sumo, self.vehicle, profile, step_s, self.speed_share * speed, np.inf)
        control.match_speed_factor(sumo, self.vehicle)
        yield from control.release(sumo, self.vehicle, step_s)
        yield from control.wait(self.slow_s, step_s)
        yield from control.fade_speed_factor(sumo, self.vehicle, factor, self.settings.recover_s, step_s)


def draw(occasion: Occasion, settings: SlowVehicles) -> SlowVehicleCommand | None:
    """Return a slow drive for a vehicle that is fast enough."""
    view, rng, slow = occasion.view, occasion.rng, settings.slow_vehicle
    if view.speed <= slow.least_speed_mps:
        return None
    return SlowVehicleCommand(view.vehicle, rng.uniform(*slow.speed_share), rng.uniform(*slow.slow_s), slow)


KIND = Kind("slow_vehicle", draw)
