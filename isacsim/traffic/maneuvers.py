"""Commanded maneuvers: each moves one vehicle along a jerk-limited profile through TraCI, then lets go gently.

A maneuver is a generator: it sends one step's commands and yields, once a simulation step, until it is over. What it
changed on the vehicle (modes, speed factor, acceleration limit) is put back by its end. Which commands SUMO obeys and
which make the vehicle jump was measured; the notes below say where that decided the form.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

Steps = Generator[None, None, None]
DEFAULT_SPEED_MODE = 31
OWN_SPEED_MODE = 32
"""Obey setSpeed with no check at all: the other modes clamp at the driver's comfortable deceleration."""
DEFAULT_LANE_CHANGE_MODE = 1621
COMMANDED_LANE_CHANGE_MODE = 512 + 1024
"""No changes of the driver's own but to the middle of the lane; commanded ones only where the gap allows."""
RUTHLESS_LANE_CHANGE_MODE = 256 + 1024
"""As commanded, without asking for a gap, but not into a vehicle alongside."""
OWN_LATERAL_MODE = 0
STOP_MPS2, STOP_MPS3 = 2.5, 5.0
"""How a vehicle comes to a stop: deceleration, m/s2, and its change, m/s3."""
SETTLE_S = 3.0
"""What a vehicle needs, once its middle has crossed a marking, to reach the middle of the new lane, s."""


class Maneuver(Protocol):
    """One vehicle's maneuver. `name` is for provenance, `vehicle` the one that moves."""

    name: str
    vehicle: str

    def steps(self, sumo: Any, step_s: float) -> Steps: ...


def ramp_hold_ramp(peak: float, rise_jerk: float, hold_s: float, fall_jerk: float, step_s: float) -> np.ndarray:
    """A trapezoid of acceleration, one value a step: peak in m/s2 (its sign is kept), jerks in m/s3."""
    size = abs(peak)
    rise = np.arange(step_s, size / rise_jerk, step_s) * rise_jerk
    fall = np.arange(step_s, size / fall_jerk, step_s) * fall_jerk
    return np.asarray(np.sign(peak) * np.concatenate([rise, np.full(round(hold_s / step_s), size), size - fall]))


def aside_and_back(offset_m: float, peak: float, hold_s: float, step_s: float) -> np.ndarray:
    """Lateral offsets, m, one a step: out along one period of a sine of acceleration, hold, and back the same way.

    peak: largest lateral acceleration, m/s2. One way takes sqrt(2 pi |offset| / peak) seconds; the jerk stays below
    2 pi peak over that time.
    """
    duration = float(np.sqrt(2.0 * np.pi * abs(offset_m) / peak))
    tau = np.arange(step_s, duration, step_s) / duration
    out = offset_m * (tau - np.sin(2.0 * np.pi * tau) / (2.0 * np.pi))
    return np.concatenate([out, np.full(round(hold_s / step_s), offset_m), out[::-1], [0.0]])


def let_go(sumo: Any, vehicle: str, step_s: float) -> Steps:
    """Give the speed back to the driver without a jump.

    Released at once, a driver below the desired speed takes the full acceleration in one step. So the vehicle first
    coasts down to the desired speed if above it, and then may accelerate by more and more over a second, until the
    driver asks for no more than that. The leader is minded all the while.
    """
    own = sumo.vehicle.getAccel(vehicle)
    sumo.vehicle.setSpeedMode(vehicle, DEFAULT_SPEED_MODE)
    yield from coast(sumo, vehicle, sumo.vehicle.getSpeedFactor(vehicle), step_s)
    speed = sumo.vehicle.getSpeed(vehicle)
    for share in np.linspace(0.0, 1.0, round(1.0 / step_s))[1:]:
        speed = min(speed, sumo.vehicle.getSpeed(vehicle)) + share * own * step_s
        sumo.vehicle.setSpeed(vehicle, speed)
        yield
    sumo.vehicle.setSpeed(vehicle, -1)


def coast(sumo: Any, vehicle: str, factor: float, step_s: float) -> Steps:
    """Give a driver a speed factor, and bring a vehicle above the desired speed of it down at 0.3 m/s2.

    Left to itself, a driver above the desired speed brakes hard, as before an obstacle. The leader is minded.
    """
    sumo.vehicle.setSpeedFactor(vehicle, factor)
    desired = sumo.vehicle.getAllowedSpeed(vehicle)
    speed = sumo.vehicle.getSpeed(vehicle)
    if speed > desired:
        match_speed_factor(sumo, vehicle)
    while speed > desired:
        speed = min(speed, sumo.vehicle.getSpeed(vehicle)) - 0.3 * step_s
        sumo.vehicle.setSpeed(vehicle, speed)
        yield
    sumo.vehicle.setSpeedFactor(vehicle, factor)
    sumo.vehicle.setSpeed(vehicle, -1)


def drive(sumo: Any, vehicle: str, accelerations: np.ndarray, step_s: float, floor: float, top: float) -> Steps:
    """Follow a profile of acceleration, m/s2, while the speed stays within floor and top, m/s; end at zero of it."""
    sumo.vehicle.setSpeedMode(vehicle, OWN_SPEED_MODE)
    speed = sumo.vehicle.getSpeed(vehicle)
    now = sumo.vehicle.getAcceleration(vehicle)
    change = 20.0 * step_s
    for wanted in accelerations:
        if speed + now * abs(now) / 40.0 <= floor or speed + now * abs(now) / 40.0 >= top:
            break
        # From the driver's own acceleration into the profile, and out of it at the limits, at no more than 20 m/s3.
        now += float(np.clip(wanted - now, -change, change))
        speed = max(0.0, speed + now * step_s)
        sumo.vehicle.setSpeed(vehicle, speed)
        yield
    while abs(now) > 1e-9:
        now -= float(np.clip(now, -change, change))
        speed = max(0.0, speed + now * step_s)
        sumo.vehicle.setSpeed(vehicle, speed)
        yield


@dataclass
class HardBrake:
    """Brake to `peak` m/s2 (negative) for a while, down to no less than 5 m/s."""

    vehicle: str
    peak: float
    rise_jerk: float
    hold_s: float
    fall_jerk: float
    name: str = "hard_brake"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        profile = ramp_hold_ramp(self.peak, self.rise_jerk, self.hold_s, self.fall_jerk, step_s)
        yield from drive(sumo, self.vehicle, profile, step_s, floor=5.0, top=np.inf)
        yield from let_go(sumo, self.vehicle, step_s)


@dataclass
class HardAccel:
    """Accelerate at `peak` m/s2 for a while, up to `top` m/s, and coast back to the desired speed."""

    vehicle: str
    peak: float
    rise_jerk: float
    hold_s: float
    fall_jerk: float
    top: float
    name: str = "hard_accel"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        profile = ramp_hold_ramp(self.peak, self.rise_jerk, self.hold_s, self.fall_jerk, step_s)
        yield from drive(sumo, self.vehicle, profile, step_s, floor=0.0, top=self.top)
        yield from let_go(sumo, self.vehicle, step_s)


def fade_speed_factor(sumo: Any, vehicle: str, end: float, over_s: float, step_s: float) -> Steps:
    """Move a driver's speed factor to another value, a little a step."""
    for factor in np.linspace(sumo.vehicle.getSpeedFactor(vehicle), end, 1 + round(over_s / step_s))[1:]:
        sumo.vehicle.setSpeedFactor(vehicle, factor)
        yield


@dataclass
class LaneChange:
    """Change by one lane to the left (+1) or right (-1) within `patience_s`, if the gaps allow."""

    vehicle: str
    direction: int
    patience_s: float
    name: str = "lane_change"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        if (yield from change_lane(sumo, self.vehicle, self.direction, self.patience_s, step_s)):
            yield from wait(SETTLE_S, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)


def change_lane(
    sumo: Any, vehicle: str, direction: int, patience_s: float, step_s: float
) -> Generator[None, None, bool]:
    """Ask for the neighbouring lane until the vehicle's middle is in it; returns whether it got there.

    The request is withdrawn then: while it stands, SUMO stops the vehicle as soon as its body is in the lane, and
    the driver cannot move on to the lane's middle.
    """
    target = sumo.vehicle.getLaneIndex(vehicle) + direction
    edge = sumo.vehicle.getRoadID(vehicle)
    sumo.vehicle.changeLane(vehicle, target, patience_s)
    for _ in range(round(patience_s / step_s)):
        yield
        if sumo.vehicle.getRoadID(vehicle) != edge:
            return False
        if sumo.vehicle.getLaneIndex(vehicle) == target:
            sumo.vehicle.changeLane(vehicle, target, 0.0)
            return True
    return False


@dataclass
class Overtake:
    """Pull out behind `other`, pass it, and come back `clearance_m` ahead of it; give up after `patience_s`."""

    vehicle: str
    other: str
    speed_gain: float
    clearance_m: float
    patience_s: float
    name: str = "overtake"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        vehicle = sumo.vehicle
        if self.other not in vehicle.getIDList():  # it left the road in the step since it was chosen
            return
        own = vehicle.getSpeedFactor(self.vehicle)
        other_own = vehicle.getSpeedFactor(self.other)
        vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        vehicle.setLaneChangeMode(self.other, COMMANDED_LANE_CHANGE_MODE)
        match_speed_factor(sumo, self.other)  # the one in front keeps its speed and lane meanwhile
        try:
            if (yield from change_lane(sumo, self.vehicle, +1, 8.0, step_s)):
                yield from fade_speed_factor(sumo, self.vehicle, own * self.speed_gain, 2.0, step_s)
                for _ in range(round(self.patience_s / step_s)):
                    if self._ahead(sumo) > self.clearance_m:
                        yield from change_lane(sumo, self.vehicle, -1, 12.0, step_s)
                        yield from wait(SETTLE_S, step_s)
                        break
                    yield
                yield from coast(sumo, self.vehicle, own, step_s)
            vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)
        finally:  # also when this vehicle leaves the network on the way
            if self.other in vehicle.getIDList():
                vehicle.setLaneChangeMode(self.other, DEFAULT_LANE_CHANGE_MODE)
                vehicle.setSpeedFactor(self.other, other_own)

    def _ahead(self, sumo: Any) -> float:
        """Gap from the other's front to this vehicle's rear, m; minus infinity once the other is gone."""
        if self.other not in sumo.vehicle.getIDList():
            return -np.inf
        distance = sumo.vehicle.getDrivingDistance(
            self.other, sumo.vehicle.getRoadID(self.vehicle), sumo.vehicle.getLanePosition(self.vehicle)
        )
        if distance < -1e6:  # SUMO's word for "behind it"
            return -np.inf
        return float(distance - sumo.vehicle.getLength(self.vehicle))


@dataclass
class Swerve:
    """Swerve `offset_m` aside (left positive) at `peak` m/s2 and back to where the vehicle was in its lane."""

    vehicle: str
    offset_m: float
    peak: float
    hold_s: float
    name: str = "evasive_swerve"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        # The mode has to stand a decision interval before the first lateral command, or that one is lost.
        sumo.vehicle.setLaneChangeMode(self.vehicle, OWN_LATERAL_MODE)
        yield from wait(0.2, step_s)
        start = sumo.vehicle.getLateralLanePosition(self.vehicle)
        lane = sumo.vehicle.getLaneID(self.vehicle)
        for offset in aside_and_back(self.offset_m, self.peak, self.hold_s, step_s):
            if sumo.vehicle.getLaneID(self.vehicle) != lane:
                break
            sumo.vehicle.setLateralLanePosition(self.vehicle, start + offset)
            yield
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)


@dataclass
class SlowVehicle:
    """Drive at a share of the present speed for a while: the disturbance others react to."""

    vehicle: str
    share: float
    for_s: float
    name: str = "slow_vehicle"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        own = sumo.vehicle.getSpeedFactor(self.vehicle)
        speed = sumo.vehicle.getSpeed(self.vehicle)
        profile = ramp_hold_ramp(-1.0, 1.0, (1.0 - self.share) * speed - 1.0, 1.0, step_s)
        yield from drive(sumo, self.vehicle, profile, step_s, floor=self.share * speed, top=np.inf)
        match_speed_factor(sumo, self.vehicle)
        yield from let_go(sumo, self.vehicle, step_s)
        yield from wait(self.for_s, step_s)
        yield from fade_speed_factor(sumo, self.vehicle, own, 8.0, step_s)


@dataclass
class StopInLane:
    """Come to a stop at STOP_MPS2, stand in the lane, and drive on: the obstacle others brake and swerve for."""

    vehicle: str
    for_s: float
    name: str = "stop_in_lane"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        speed = sumo.vehicle.getSpeed(self.vehicle)
        profile = ramp_hold_ramp(-STOP_MPS2, STOP_MPS3, speed / STOP_MPS2, STOP_MPS3, step_s)
        yield from drive(sumo, self.vehicle, profile, step_s, floor=0.0, top=np.inf)
        sumo.vehicle.setSpeed(self.vehicle, 0.0)
        yield from wait(self.for_s, step_s)
        yield from let_go(sumo, self.vehicle, step_s)


@dataclass
class ClosedRampEnd:
    """Keep to a lane that ends, stop at a place before its end, stand, and drive on: who follows has to merge before.

    lane: the lane the vehicle is in. place_m: where its front bumper stops, from the lane's begin. Nobody may be
    between the vehicle and the place. It gives up if it has not begun to brake within `patience_s`.
    """

    vehicle: str
    lane: str
    place_m: float
    for_s: float
    patience_s: float
    name: str = "closed_ramp_end"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, COMMANDED_LANE_CHANGE_MODE)
        for _ in range(round(self.patience_s / step_s)):
            if self.reached(sumo) or sumo.vehicle.getLaneID(self.vehicle) != self.lane:
                break
            yield
        if self.reached(sumo):
            yield from StopInLane(self.vehicle, self.for_s).steps(sumo, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)

    def reached(self, sumo: Any) -> bool:
        """Whether the vehicle, in its lane, is as near to the place as stopping takes, or nearer."""
        left_m = self.place_m - sumo.vehicle.getLanePosition(self.vehicle)
        here = sumo.vehicle.getLaneID(self.vehicle) == self.lane
        return bool(here and left_m <= stopping_m(sumo.vehicle.getSpeed(self.vehicle)))


@dataclass
class CutIn:
    """Change lanes close in front of a follower there, who has to brake."""

    vehicle: str
    direction: int
    name: str = "cut_in"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, RUTHLESS_LANE_CHANGE_MODE)
        if (yield from change_lane(sumo, self.vehicle, self.direction, 5.0, step_s)):
            yield from wait(SETTLE_S, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)


def stopping_m(speed: float) -> float:
    """What `StopInLane` takes to come to a stand from a speed, m/s: m.

    v^2 / 2a, and half of what is driven at full speed in the time in which the deceleration a rises.
    """
    return speed**2 / (2.0 * STOP_MPS2) + speed * STOP_MPS2 / (2.0 * STOP_MPS3)


def wait(for_s: float, step_s: float) -> Steps:
    """Send nothing for a while."""
    for _ in range(round(for_s / step_s)):
        yield


def match_speed_factor(sumo: Any, vehicle: str) -> None:
    """Make the desired speed one hundredth more than the present one, so that the driver stays below it."""
    own = sumo.vehicle.getSpeedFactor(vehicle)
    present = sumo.vehicle.getSpeed(vehicle) / sumo.vehicle.getAllowedSpeed(vehicle)
    sumo.vehicle.setSpeedFactor(vehicle, float(1.01 * present * own))
