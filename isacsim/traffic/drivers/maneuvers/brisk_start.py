"""A hard start at a traffic light: SUMO's driver may accelerate more than usual for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps, wait
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate

STARTS_MPS = 0.3
"""A vehicle that stood has started at this speed, m/s."""


class BriskStartSettings(Settings):
    """A hard acceleration from a standstill when the light turns green or the queue moves."""

    wait_s: kinds.Duration = sourced(
        90.0, "given up when not moving after this time, s", "chosen: longer than a red light"
    )
    within_m: kinds.Distance = sourced(
        80.0, "only vehicles that stand this close to a traffic light, m", "chosen: the queue"
    )
    peak_mps2: kinds.Accelerations = sourced(
        (3.0, 4.8), "acceleration that the driver may use, m/s2",
        "chosen: around the 3.6 m/s² of studies of driving style",
    )  # fmt: skip
    rise_s: float = sourced(0.6, "time over which it comes and goes, s", "chosen: no jump", gt=0.0, le=10.0)
    lasts_s: kinds.Durations = sourced(
        (3.0, 6.0), "time for which the driver may use it, s", "chosen: up to the usual speed in a street"
    )


class BriskStarts(DirectorSettings):
    brisk_start_per_vehicle_hour: float = rate("hard starts at traffic lights, of vehicles that stand there", 30.0)
    brisk_start: BriskStartSettings = BriskStartSettings()


@dataclass
class BriskStart(ManeuverCommand):
    """Start hard when the light turns green: SUMO's driver may accelerate by `peak_mps2` for a while.

    The driver keeps its distance and obeys the light. settings: the times. lasts_s: how long, s.
    """

    vehicle: str
    peak_mps2: float
    lasts_s: float
    settings: BriskStartSettings
    name = "hard_accel"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        get = sumo.vehicle
        for _ in range(round(self.settings.wait_s / step_s)):
            if get.getSpeed(self.vehicle) > STARTS_MPS:
                break
            yield
        else:
            return
        self.cause = "green_light"
        usual = float(get.getAccel(self.vehicle))
        peak = max(self.peak_mps2, usual)
        yield from self._fade(sumo, usual, peak, step_s)
        yield from wait(self.lasts_s, step_s)
        yield from self._fade(sumo, peak, usual, step_s)

    def _fade(self, sumo: Any, start: float, end: float, step_s: float) -> Steps:
        for acceleration in np.linspace(start, end, 1 + round(self.settings.rise_s / step_s))[1:]:
            sumo.vehicle.setAccel(self.vehicle, float(acceleration))
            yield


def draw(occasion: Occasion, settings: BriskStarts) -> BriskStart | None:
    """Return a hard start for a car that stands at a traffic light."""
    view, rng, start = occasion.view, occasion.rng, settings.brisk_start
    if not view.is_car or not view.stands_at_light(start.within_m):
        return None
    return BriskStart(view.vehicle, rng.uniform(*start.peak_mps2), rng.uniform(*start.lasts_s), start)


KIND = Kind("brisk_start", draw, near_junctions=True)
