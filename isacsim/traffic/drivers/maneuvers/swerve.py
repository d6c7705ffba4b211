"""A swerve without a cause: aside within the lane, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.controls import MODE_S, Foot, Hands, pedal_limit
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import Driver, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import DEFAULT_LANE_CHANGE_MODE, Steps, release, wait
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.evasion import Evasions
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import Kind, ManeuverCommand, Occasion, rate


class SwerveCommandSettings(Settings):
    """An evasive swerve without a cause: aside within the lane, and back."""

    least_speed_mps: kinds.Speed = sourced(
        10.0, "only faster vehicles swerve, m/s", "chosen: below, drivers brake instead"
    )
    offset_m: kinds.Distances = sourced(
        (0.9, 1.7), "how far aside, m", "measured: 0.9 to 1.7 m are driven without a jump"
    )
    peak_mps2: kinds.Accelerations = sourced(
        (4.0, 7.0), "largest lateral acceleration that is meant, m/s2", "driving experiments: 0.3 to 0.7 g"
    )
    hold_s: kinds.Durations = sourced(
        (0.0, 0.8), "time aside before moving back, s", "chosen: out and back in one motion"
    )


class Swerves(Evasions):
    swerve_per_vehicle_hour: float = rate("commanded evasive swerves", 0.5)
    swerve: SwerveCommandSettings = SwerveCommandSettings()


@dataclass
class SwerveCommand(ManeuverCommand):
    """Swerve without a cause: `offset_m` aside (positive to the faster side) at up to `peak_mps2`, and back.

    hold_s: time between reaching the offset and turning back, s.
    """

    vehicle: str
    offset_m: float
    peak_mps2: float
    hold_s: float
    driver: Driver
    rng: np.random.Generator
    name = "evasive_swerve"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        hands = Hands(sumo, self.vehicle, self.driver, step_s, self.rng)
        yield from wait(MODE_S, step_s)
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        reached_s = 0.0
        for _ in range(round(kinds.LONGEST_S / step_s)):
            if abs(hands.moved_m) > 0.85 * abs(self.offset_m) or reached_s:
                reached_s += step_s
            out = reached_s <= self.hold_s
            limit = pedal_limit(hands.limb.acceleration)
            foot.push(lambda: -min(kinds.braking_for_leader(sumo, self.vehicle, foot.speed), limit))  # noqa: B023 - called now
            hands.steer(self.offset_m if out else 0.0, self.peak_mps2 if out else kinds.BACK_SHARE * self.peak_mps2)
            yield
            if not out and hands.still:
                break
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)


def draw(occasion: Occasion, settings: Swerves) -> SwerveCommand | None:
    """Return a swerve for a car with room beside; no further aside than its lane."""
    view, rng, swerve, evasion = occasion.view, occasion.rng, settings.swerve, settings.evasion
    if not view.is_car or view.speed <= swerve.least_speed_mps or not view.is_steady:
        return None
    clear = evasion.clear_beside_m, evasion.clear_beside_s
    sides = [side for side in (kinds.FASTER, kinds.SLOWER) if view.has_room_beside(side, *clear)]
    if not sides:
        return None
    low, high = swerve.offset_m
    high = min(high, view.lane_width_m / 2.0 - evasion.lane_margin_m)
    offset = rng.uniform(min(low, high), high)
    side = float(rng.choice(sides))
    peak, hold = rng.uniform(*swerve.peak_mps2), rng.uniform(*swerve.hold_s)
    return SwerveCommand(view.vehicle, side * offset, peak, hold, draw_driver(settings.driver, rng), rng.spawn(1)[0])


KIND = Kind("swerve", draw)
