"""A hard brake without a cause: the driver brakes harder and harder, and then on until the speed has fallen enough."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.controls import Foot
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import Driver, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps, release
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate

SHORTEST_RISE_S = 0.05
"""Lower end of a range of rise times, where the range begins below it, s: it has a logarithm."""


class BrakeCommandSettings(Settings):
    """A hard brake without a cause: the driver model brakes until the speed has fallen enough."""

    least_speed_mps: kinds.Speed = sourced(
        14.0, "only faster vehicles brake, m/s", "chosen: below, most brakes would be cut at floor_mps"
    )
    peak_mps2: kinds.Accelerations = sourced(
        (3.6, 8.0), "largest deceleration that is meant, m/s2; the smaller the likelier, never the largest",
        "measured: half of SUMO's own hard brakes stay below 5 m/s²",
    )  # fmt: skip
    rise_s: kinds.Durations = sourced(
        (0.1, 8.0), "time over which the driver brakes harder and harder, s; drawn evenly in its logarithm",
        "measured: half of SUMO's own hard brakes take 0.3 to 3 s to 4 m/s²",
    )  # fmt: skip
    drop_mps: kinds.Speeds = sourced(
        (4.0, 14.0), "by how much the speed falls beside what that takes, m/s", "chosen: brakes of 1 to 3 s"
    )
    floor_mps: kinds.Speed = sourced(5.0, "the speed falls no lower, m/s", "chosen: the vehicle keeps moving")


class HardBrakes(DirectorSettings):
    hard_brake_per_vehicle_hour: float = rate("commanded hard brakes", 2.0)
    hard_brake: BrakeCommandSettings = BrakeCommandSettings()


@dataclass
class BrakeCommand(ManeuverCommand):
    """Brake without a cause: harder and harder for `rise_s`, up to `peak_mps2`, and then on.

    The speed falls by `drop_mps` beside what `rise_s` takes, but not below `floor_mps`.
    """

    vehicle: str
    peak_mps2: float
    rise_s: float
    drop_mps: float
    floor_mps: float
    driver: Driver
    rng: np.random.Generator
    name = "hard_brake"
    startles = 0

    def steps(self, sumo: Any, step_s: float) -> Steps:
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        goal = max(self.floor_mps, foot.speed - self.peak_mps2 * self.rise_s / 2.0 - self.drop_mps)
        for step in range(round(kinds.LONGEST_S / step_s)):
            risen = min(1.0, step * step_s / self.rise_s) if self.rise_s else 1.0
            limit = risen * self.peak_mps2
            foot.push(lambda: min(max(kinds.EAGERNESS_PER_S * (goal - foot.speed), -limit), 0.0))  # noqa: B023 - called now
            yield
            if foot.speed < goal + 0.5:
                break
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)


def draw(occasion: Occasion, settings: HardBrakes) -> BrakeCommand | None:
    """Return a brake for a vehicle that is fast enough."""
    view, rng, brake = occasion.view, occasion.rng, settings.hard_brake
    if view.speed <= brake.least_speed_mps:
        return None
    low, high = brake.peak_mps2
    peak = rng.triangular(low, low, high) if high > low else low
    low, high = brake.rise_s
    rise = np.exp(rng.uniform(*np.log(np.maximum([low, high], SHORTEST_RISE_S)))) if high > low else low
    drop = rng.uniform(*brake.drop_mps)
    driver = draw_driver(settings.driver, rng)
    return BrakeCommand(view.vehicle, peak, rise, drop, brake.floor_mps, driver, rng.spawn(1)[0])


KIND = Kind("hard_brake", draw, near_junctions=True)
