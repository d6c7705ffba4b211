"""A hard acceleration of a car: into room ahead, off a lane that ends, or without a cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.controls import Foot
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import Driver, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps, release, wait
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate

CLOSING_MPS2 = 1.5
"""An accelerating driver eases off where closing in on the vehicle ahead would take a stronger deceleration, m/s2."""


class AccelCommandSettings(Settings):
    """A hard acceleration of a car: into a gap, onto the main road, or without a cause."""

    least_speed_mps: kinds.Speed = sourced(
        5.0, "only faster vehicles accelerate, m/s", "chosen: starts are a section of their own"
    )
    peak_mps2: kinds.Accelerations = sourced(
        (2.8, 4.8), "largest acceleration that is meant, m/s2",
        "chosen: around the 3.6 m/s² of studies of driving style",
    )  # fmt: skip
    power_w_per_kg: kinds.Factors = sourced(
        (80.0, 140.0), "engine power per mass, W/kg, which limits acceleration times speed",
        "chosen: cars of 120 to 210 kW and 1500 kg",
    )  # fmt: skip
    gain_mps: kinds.Speeds = sourced(
        (5.0, 14.0), "by how much the speed grows at most, m/s", "chosen: accelerations of 1.5 to 4 s"
    )
    least_gain_mps: kinds.Speed = sourced(
        4.5, "no acceleration where there is no room for this gain, m/s", "chosen: 2.5 m/s² for 1 s, and the ramps"
    )
    headway_s: kinds.Durations = sourced(
        (0.4, 1.0), "time gap at which the driver stops closing in, s", "published: Vogel 2003, headways of below 1 s"
    )
    impatience_gain: kinds.Factors = sourced(
        (1.0, 1.25), "speed that an impatient driver accepts, over its usual desired speed", "chosen: for a while"
    )


class HardAccels(DirectorSettings):
    surge_per_vehicle_hour: float = rate("chances to accelerate hard into room ahead that are taken", 30.0)
    hard_accel_per_vehicle_hour: float = rate("commanded hard accelerations", 1.0)
    hard_accel: AccelCommandSettings = AccelCommandSettings()


@dataclass
class Surge(ManeuverCommand):
    """Accelerate to `goal_mps`, as hard as the driver means and the engine gives, behind whoever is ahead.

    peak_mps2: largest acceleration that is meant. power_w_per_kg: of the vehicle; limits acceleration times speed.
    headway_s: time gap to the vehicle ahead at which the driver stops accelerating. reason: the cause to note, empty
    where there is none.
    """

    vehicle: str
    goal_mps: float
    peak_mps2: float
    power_w_per_kg: float
    headway_s: float
    driver: Driver
    rng: np.random.Generator
    reason: str = ""
    name = "hard_accel"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        if self.reason:
            yield from wait(self.driver.reaction_s, step_s)
        self.cause = self.reason
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        for step in range(round(kinds.LONGEST_S / step_s)):
            foot.push(lambda: self._meant(sumo, foot.speed))
            yield
            eased = foot.limb.acceleration < 0.5 and step * step_s > 1.0
            if foot.speed > self.goal_mps - 0.3 or eased:
                break
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)

    def _meant(self, sumo: Any, speed: float) -> float:
        limit = min(self.peak_mps2, self.power_w_per_kg / max(speed, 1.0))
        meant = min(max(kinds.EAGERNESS_PER_S * (self.goal_mps - speed), -limit), limit)
        leader = sumo.vehicle.getLeader(self.vehicle, kinds.LEADER_M)
        if leader:
            room = leader[1] - kinds.STANDSTILL_M - speed * self.headway_s
            closing = max(0.0, speed - float(sumo.vehicle.getSpeed(leader[0])))
            needed = closing**2 / (2.0 * max(room, 0.5))
            meant = min(meant, limit * (1.0 - needed / CLOSING_MPS2)) if needed < CLOSING_MPS2 else -needed
        return max(meant, -2.0 * CLOSING_MPS2)


def draw(occasion: Occasion, settings: HardAccels, reason: str = "") -> Surge | None:
    """Return an acceleration for a car that has room for it. reason: the cause to note, may be empty."""
    view, rng, accel = occasion.view, occasion.rng, settings.hard_accel
    speed = view.speed
    if speed <= accel.least_speed_mps or not view.is_car:
        return None
    ranges = accel.peak_mps2, accel.power_w_per_kg, accel.gain_mps, accel.headway_s, accel.impatience_gain
    peak, power, gain, headway, impatience = (rng.uniform(*ends) for ends in ranges)
    goal = min(speed + gain, impatience * view.allowed_speed)
    if view.leader is not None:
        # The speed from which the driver can still close in without braking hard.
        room = max(0.0, view.gap_m - kinds.STANDSTILL_M - headway * speed)
        goal = min(goal, view.leader_speed + (2.0 * CLOSING_MPS2 * room) ** 0.5)
    if goal < speed + accel.least_gain_mps:
        return None
    driver = draw_driver(settings.driver, rng)
    return Surge(view.vehicle, goal, peak, power, headway, driver, rng.spawn(1)[0], reason)


def draw_surge(occasion: Occasion, settings: HardAccels) -> Surge | None:
    """Return an acceleration that has a cause: the end of the lane, or room behind the vehicle ahead."""
    if occasion.lane_ends:
        return draw(occasion, settings, "merge")
    return None if occasion.view.leader is None else draw(occasion, settings, "gap_ahead")


SURGE, KIND = Kind("surge", draw_surge), Kind("hard_accel", draw)
