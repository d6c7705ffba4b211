"""What a driver may have to evade: something in the road, or the vehicle ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

STANDS_MPS, BRAKES_MPS2 = 2.0, -1.0
"""A vehicle below this speed stands; one that decelerates by more brakes."""
UNREACHABLE_M = -1e6
"""SUMO's driving distance to a place that is not ahead is below this, m."""


class Hazard(Protocol):
    """Something ahead of a vehicle that it may have to evade."""

    def shows(self, sumo: Any, vehicle: str) -> bool:
        """Return whether it has become a hazard to a vehicle yet."""

    def gap_m(self, sumo: Any, vehicle: str) -> float:
        """Return the distance from the vehicle's front to it, m; negative once passed, infinite once gone."""

    def motion(self, sumo: Any) -> tuple[float, float]:
        """Return its speed, m/s, and its acceleration, m/s2."""

    def cause(self, sumo: Any) -> str:
        """Return the name under which a reaction to it is noted."""


@dataclass(frozen=True)
class Debris:
    """An object that lies in a lane. Only drivers see it; SUMO does not know of it.

    lane: SUMO id. at_m: from the lane's beginning, m. lateral_m: from the lane's centre, faster side positive, m.
    half_width_m: half its width, m. until: time at which it is gone, s.
    """

    lane: str
    at_m: float
    lateral_m: float
    half_width_m: float
    until: float

    def shows(self, sumo: Any, vehicle: str) -> bool:
        return True

    def gap_m(self, sumo: Any, vehicle: str) -> float:
        if sumo.vehicle.getRoadID(vehicle) != sumo.lane.getEdgeID(self.lane):
            return -np.inf
        return float(self.at_m - sumo.vehicle.getLanePosition(vehicle))

    def motion(self, sumo: Any) -> tuple[float, float]:
        return 0.0, 0.0

    def cause(self, sumo: Any) -> str:
        return "debris"


@dataclass(frozen=True)
class VehicleAhead:
    """Another vehicle on the road ahead. cut_in: whether it has just come over from another lane."""

    vehicle: str
    cut_in: bool = False

    def shows(self, sumo: Any, vehicle: str) -> bool:
        if self.vehicle not in sumo.vehicle.getIDList():
            return False
        if self.cut_in:
            return bool(sumo.vehicle.getLaneID(self.vehicle) == sumo.vehicle.getLaneID(vehicle))
        return bool(sumo.vehicle.getAcceleration(self.vehicle) < BRAKES_MPS2)

    def gap_m(self, sumo: Any, vehicle: str) -> float:
        get = sumo.vehicle
        if self.vehicle not in get.getIDList():
            return np.inf
        length = get.getLength(self.vehicle)
        edge, place = get.getRoadID(self.vehicle), get.getLanePosition(self.vehicle)
        if edge == get.getRoadID(vehicle):
            return float(place - length - get.getLanePosition(vehicle))
        distance = get.getDrivingDistance(vehicle, edge, place)
        return float(distance - length) if distance > UNREACHABLE_M else np.inf

    def motion(self, sumo: Any) -> tuple[float, float]:
        if self.vehicle not in sumo.vehicle.getIDList():
            return np.inf, 0.0
        return float(sumo.vehicle.getSpeed(self.vehicle)), float(sumo.vehicle.getAcceleration(self.vehicle))

    def cause(self, sumo: Any) -> str:
        speed, acceleration = self.motion(sumo)
        if speed < STANDS_MPS:
            return "stopped_leader"
        if self.cut_in:
            return "cut_in"
        return "braking_leader" if acceleration < BRAKES_MPS2 else "slow_leader"


def time_to_collision_s(gap_m: float, closing_mps: float) -> float:
    """Return the time until a gap closes at a constant closing speed, s; infinite where it does not close."""
    return gap_m / closing_mps if closing_mps > 0.0 and gap_m > 0.0 else np.inf
