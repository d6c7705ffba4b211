"""Lane changes, overtakes and disturbances: each moves one vehicle through TraCI, then gives it back to its driver.

`steps` is a generator that sends one step's commands and yields, once a simulation step, until the maneuver is over.
By its end, everything it changed on the vehicle (modes, speed factor, acceleration limit) is restored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from isac_cosim.isacsim.traffic.drivers.command_settings import (
    OvertakeCommandSettings,
    SlowVehicleCommandSettings,
    StopInLaneCommandSettings,
)
from isac_cosim.isacsim.traffic.drivers.vehicle_control import (
    COMMANDED_LANE_CHANGE_MODE,
    DEFAULT_LANE_CHANGE_MODE,
    FORCED_LANE_CHANGE_MODE,
    SETTLE_S,
    Steps,
    change_lane,
    coast,
    fade_speed_factor,
    follow_profile,
    match_speed_factor,
    ramp_hold_ramp,
    release,
    wait,
)
from isac_cosim.isacsim.traffic.drivers.vehicle_view import is_parked


class ManeuverCommand(Protocol):
    """A maneuver that one vehicle is commanded to drive.

    name: stored with the recording, for provenance. vehicle: SUMO id of the vehicle that moves.
    """

    name: str
    vehicle: str

    def steps(self, sumo: Any, step_s: float) -> Steps:
        """Send the commands, one simulation step at a time. sumo: the running libsumo module."""


@dataclass
class LaneChangeCommand:
    """Change by one lane to the faster (direction +1) or slower side (-1) within `patience_s`, if the gaps allow."""

    vehicle: str
    direction: int
    patience_s: float
    name: str = "lane_change"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        if (yield from change_lane(sumo, self.vehicle, self.direction, self.patience_s, step_s)):
            yield from wait(SETTLE_S, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)


@dataclass
class OvertakeCommand:
    """Pull out behind another vehicle, pass it, and return ahead of it.

    other: SUMO id of the vehicle to pass. speed_gain: factor on the desired speed meanwhile. clearance_m: gap between
    this vehicle's rear and the other's front at which the return begins, m. settings: the times it may take.
    """

    vehicle: str
    other: str
    speed_gain: float
    clearance_m: float
    settings: OvertakeCommandSettings
    name: str = "overtake"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        vehicle = sumo.vehicle
        if self.other not in vehicle.getIDList() or is_parked(sumo, self.other):
            return  # it left the road in the step since it was chosen
        factor, other_factor = vehicle.getSpeedFactor(self.vehicle), vehicle.getSpeedFactor(self.other)
        vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        vehicle.setLaneChangeMode(self.other, COMMANDED_LANE_CHANGE_MODE)
        match_speed_factor(sumo, self.other)  # the one ahead keeps its speed and lane meanwhile
        try:
            if (yield from change_lane(sumo, self.vehicle, +1, self.settings.pull_out_s, step_s)):
                yield from self._pass_and_return(sumo, factor * self.speed_gain, step_s)
                yield from coast(sumo, self.vehicle, factor, step_s)
            vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)
        finally:  # also when this vehicle leaves the network on the way
            if self.other in vehicle.getIDList():
                vehicle.setLaneChangeMode(self.other, DEFAULT_LANE_CHANGE_MODE)
                vehicle.setSpeedFactor(self.other, other_factor)

    def _pass_and_return(self, sumo: Any, speed_factor: float, step_s: float) -> Steps:
        yield from fade_speed_factor(sumo, self.vehicle, speed_factor, self.settings.speed_up_s, step_s)
        for _ in range(round(self.settings.pass_s / step_s)):
            if self._clearance_m(sumo) > self.clearance_m:
                yield from change_lane(sumo, self.vehicle, -1, self.settings.return_s, step_s)
                yield from wait(SETTLE_S, step_s)
                break
            yield

    def _clearance_m(self, sumo: Any) -> float:
        """Gap from the other's front to this vehicle's rear, m; minus infinity once the other is gone."""
        if self.other not in sumo.vehicle.getIDList():
            return -np.inf
        distance = sumo.vehicle.getDrivingDistance(
            self.other, sumo.vehicle.getRoadID(self.vehicle), sumo.vehicle.getLanePosition(self.vehicle)
        )
        if distance < -1e6:  # SUMO's value for "behind it"
            return -np.inf
        return float(distance - sumo.vehicle.getLength(self.vehicle))


@dataclass
class SlowVehicleCommand:
    """Drive at `speed_share` of the present speed for `slow_s`: a disturbance that others react to."""

    vehicle: str
    speed_share: float
    slow_s: float
    settings: SlowVehicleCommandSettings
    name: str = "slow_vehicle"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        factor = sumo.vehicle.getSpeedFactor(self.vehicle)
        speed = sumo.vehicle.getSpeed(self.vehicle)
        peak, jerk = self.settings.deceleration_mps2, self.settings.jerk_mps3
        # The ramps together take away peak^2 / jerk of the speed, the hold the rest.
        hold_s = max(0.0, (1.0 - self.speed_share) * speed / peak - peak / jerk)
        profile = ramp_hold_ramp(-peak, jerk, hold_s, jerk, step_s)
        yield from follow_profile(sumo, self.vehicle, profile, step_s, self.speed_share * speed, np.inf)
        match_speed_factor(sumo, self.vehicle)
        yield from release(sumo, self.vehicle, step_s)
        yield from wait(self.slow_s, step_s)
        yield from fade_speed_factor(sumo, self.vehicle, factor, self.settings.recover_s, step_s)


@dataclass
class StopInLaneCommand:
    """Stop, stand in the lane for `stand_s`, and drive on: an obstacle that others brake and swerve for."""

    vehicle: str
    stand_s: float
    settings: StopInLaneCommandSettings
    name: str = "stop_in_lane"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        speed = sumo.vehicle.getSpeed(self.vehicle)
        peak, jerk = self.settings.deceleration_mps2, self.settings.jerk_mps3
        profile = ramp_hold_ramp(-peak, jerk, speed / peak, jerk, step_s)
        yield from follow_profile(sumo, self.vehicle, profile, step_s, 0.0, np.inf)
        sumo.vehicle.setSpeed(self.vehicle, 0.0)
        yield from wait(self.stand_s, step_s)
        yield from release(sumo, self.vehicle, step_s)


@dataclass
class ClosedRampEndCommand:
    """Keep to a lane that ends, stop before its end, stand, and drive on: vehicles behind have to merge earlier.

    lane: the lane that the vehicle is in. place_m: where its front bumper stops, from the lane's beginning, m. No
    vehicle may be between it and the place. stand_s: time at a standstill, s. patience_s: given up if the vehicle has
    not begun to brake by then, s. stop: how it stops.
    """

    vehicle: str
    lane: str
    place_m: float
    stand_s: float
    patience_s: float
    stop: StopInLaneCommandSettings
    name: str = "closed_ramp_end"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        for _ in range(round(self.patience_s / step_s)):
            if self.reached(sumo) or sumo.vehicle.getLaneID(self.vehicle) != self.lane:
                break
            yield
        if self.reached(sumo):
            yield from StopInLaneCommand(self.vehicle, self.stand_s, self.stop).steps(sumo, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)

    def reached(self, sumo: Any) -> bool:
        """Whether the vehicle, in its lane, is as close to the place as stopping takes, or closer."""
        left_m = self.place_m - sumo.vehicle.getLanePosition(self.vehicle)
        in_lane = sumo.vehicle.getLaneID(self.vehicle) == self.lane
        return bool(in_lane and left_m <= stopping_m(sumo.vehicle.getSpeed(self.vehicle), self.stop))


@dataclass
class CutInCommand:
    """Change lanes close in front of a vehicle there, which has to brake.

    direction: +1 to the faster side, -1 to the slower.
    """

    vehicle: str
    direction: int
    patience_s: float
    name: str = "cut_in"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, FORCED_LANE_CHANGE_MODE)
        if (yield from change_lane(sumo, self.vehicle, self.direction, self.patience_s, step_s)):
            yield from wait(SETTLE_S, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)


def stopping_m(speed_mps: float, stop: StopInLaneCommandSettings) -> float:
    """Return the distance in which `StopInLaneCommand` comes to a standstill, m.

    v^2 / 2a, plus half of what is driven at full speed while the deceleration a rises.
    """
    peak, jerk = stop.deceleration_mps2, stop.jerk_mps3
    return speed_mps**2 / (2.0 * peak) + speed_mps * peak / (2.0 * jerk)
