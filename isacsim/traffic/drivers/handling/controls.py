"""Foot and hands on one vehicle in SUMO: a driver's decisions become speeds and lateral positions, step by step."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from isac_cosim.isacsim.traffic.drivers.handling.driver_model import BRAKING_LIMIT_MPS2, Driver, Limb, approach_mps2
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import open_to
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import NO_LATERAL_MODE, UNCHECKED_SPEED_MODE, Steps

MODE_S = 0.2
"""SUMO drops lateral positions unless the mode was set a decision interval before, s."""
STILL_MPS, STILL_MPS2, STILL_M = 0.12, 0.1, 0.2
"""Below these a vehicle has come to rest at its goal: lateral speed, acceleration, and distance."""
EAGERNESS_PER_S = 4.5
"""How strongly hands correct a lateral speed, 1/s: swerves overshoot a little and settle."""
EASE_SHARE = 0.7
"""Lateral acceleration with which a driver plans to come to rest aside, as a share of the largest that is meant."""


class Foot:
    """The pedals: takes the speed over from SUMO's driver at its present acceleration.

    The vehicle then obeys without any check of its own; the driver who holds this foot has to look out.
    """

    def __init__(self, sumo: Any, vehicle: str, driver: Driver, step_s: float, rng: np.random.Generator) -> None:
        self._sumo, self._vehicle, self._step_s = sumo, vehicle, step_s
        sumo.vehicle.setSpeedMode(vehicle, UNCHECKED_SPEED_MODE)
        self.speed = float(sumo.vehicle.getSpeed(vehicle))
        present = float(sumo.vehicle.getAcceleration(vehicle))
        self.limb = Limb(driver, driver.pedal_lag_s, present, step_s, rng)

    def push(self, demand: Callable[[], float]) -> None:
        """Drive one step towards an acceleration, m/s2."""
        self.speed = max(0.0, self.speed + self.limb.follow(demand) * self._step_s)
        self._sumo.vehicle.setSpeed(self._vehicle, self.speed)

    @property
    def still(self) -> bool:
        """Whether the vehicle neither brakes nor accelerates, or stands."""
        return abs(self.limb.acceleration) < STILL_MPS2 or self.speed == 0.0

    def lift(self) -> Steps:
        """Let go of the pedals: the acceleration fades out."""
        self.limb.decide_now()
        while not self.still:
            self.push(lambda: 0.0)
            yield


class Hands:
    """The steering wheel: moves the vehicle to a lateral goal, m from where it was taken over, faster side positive.

    Create it `MODE_S` before the first `steer`.
    """

    def __init__(self, sumo: Any, vehicle: str, driver: Driver, step_s: float, rng: np.random.Generator) -> None:
        self._sumo, self._vehicle, self._step_s = sumo, vehicle, step_s
        sumo.vehicle.setLaneChangeMode(vehicle, NO_LATERAL_MODE)
        # Lateral place of the start and of the middle of the present lane, from the middle of the lane at the start.
        self._start_m = float(sumo.vehicle.getLateralLanePosition(vehicle))
        self._middle_m = 0.0
        self.limb = Limb(driver, driver.steering_lag_s, 0.0, step_s, rng)
        self.moved_m = 0.0
        self.lateral_mps = 0.0
        self._goal_m = 0.0
        self._anticipation_s = 2.0 * driver.steering_lag_s + 0.5 * driver.correction_s

    def steer(self, goal_m: float, limit_mps2: float) -> None:
        """Drive one step towards a lateral goal, m. limit_mps2: largest lateral acceleration that is meant."""
        if goal_m != self._goal_m:
            self._goal_m = goal_m
            self.limb.decide_now()
        acceleration = self.limb.follow(lambda: self._meant(limit_mps2))
        self.lateral_mps += acceleration * self._step_s
        self.moved_m += self.lateral_mps * self._step_s
        self._sumo.vehicle.setLateralLanePosition(self._vehicle, self._within_lane_m())

    def _meant(self, limit_mps2: float) -> float:
        """The lateral acceleration that the driver means now, for where the vehicle will be when it takes effect."""
        ahead_s, acceleration = self._anticipation_s, self.limb.acceleration
        rate = self.lateral_mps + acceleration * ahead_s
        error = self._goal_m - self.moved_m - self.lateral_mps * ahead_s - 0.5 * acceleration * ahead_s**2
        return approach_mps2(error, rate, limit_mps2, EASE_SHARE * limit_mps2, EAGERNESS_PER_S)

    def _within_lane_m(self) -> float:
        """Return the place from the middle of the lane that it is in; move the vehicle to the next lane if needed.

        SUMO leaves a vehicle whose lateral position is set in its lane, however far it is aside. There it also stays if
        the next lane is closed to it, such as a pavement.
        """
        sumo, vehicle = self._sumo, self._vehicle
        edge, index = sumo.vehicle.getRoadID(vehicle), sumo.vehicle.getLaneIndex(vehicle)
        width = float(sumo.lane.getWidth(f"{edge}_{index}"))
        place = float(self._start_m + self.moved_m - self._middle_m)
        side = int(math.copysign(1.0, place))
        if abs(place) <= width / 2.0 or edge.startswith(":") or not 0 <= index + side < sumo.edge.getLaneNumber(edge):
            return place
        lane = f"{edge}_{index + side}"
        if not open_to(sumo, lane, sumo.vehicle.getVehicleClass(vehicle)):
            return place
        sumo.vehicle.moveTo(vehicle, lane, sumo.vehicle.getLanePosition(vehicle))
        step = side * (width + float(sumo.lane.getWidth(lane))) / 2.0
        self._middle_m += step
        return place - step

    @property
    def still(self) -> bool:
        """Whether the vehicle rests at its goal."""
        at_goal = abs(self.moved_m - self._goal_m) < STILL_M
        return at_goal and abs(self.lateral_mps) < STILL_MPS and abs(self.limb.acceleration) < 5.0 * STILL_MPS2


def pedal_limit(steering_mps2: float) -> float:
    """Return what the tyres leave for braking beside a lateral acceleration, m/s2."""
    return math.sqrt(max(BRAKING_LIMIT_MPS2**2 - steering_mps2**2, 1.0))
