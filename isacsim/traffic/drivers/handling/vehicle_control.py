"""How one vehicle is moved through TraCI without a jump: acceleration profiles, lane changes, and the release.

SUMO obeys some commands exactly, clamps others, and answers a few with a jump in one step. Which does what was measured
on single vehicles; the docstrings say where a measurement decided the form.

Every function that takes time is a generator: it sends the commands of one simulation step, then yields.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.setting_fields import LARGEST_MPS3

Steps = Generator[None, None, None]
"""Sends the commands of one simulation step each time it is resumed."""
Ask = Callable[[str, float], None]
"""Sets the speed of a vehicle for the next step, m/s."""

DEFAULT_SPEED_MODE = 31
UNCHECKED_SPEED_MODE = 32
"""Obey setSpeed without any check. The other modes clamp at the driver's comfortable deceleration."""
DEFAULT_LANE_CHANGE_MODE = 1621
COMMANDED_LANE_CHANGE_MODE = 512 + 1024
"""The driver only moves to the middle of the lane. Commanded changes wait for a safe gap."""
FORCED_LANE_CHANGE_MODE = 256 + 1024
"""As `COMMANDED_LANE_CHANGE_MODE`, but without waiting for a gap. Never into a vehicle alongside."""
NO_LATERAL_MODE = 0
"""The driver does not move sideways at all."""
RELEASE_S = 1.0
"""Time over which the driver gets the full acceleration back, s."""
LEAST_SPEED_FACTOR = 0.05
"""A driver that stands for a moment still wants to drive."""
COAST_MPS2 = 0.3
"""Deceleration of a vehicle that is released above its desired speed, m/s2."""
SETTLE_S = 3.0
"""Time from the vehicle's middle crossing a marking until it has reached the middle of the new lane, s."""


def ramp_hold_ramp(peak_mps2: float, rise_mps3: float, hold_s: float, fall_mps3: float, step_s: float) -> Array:
    """Return a trapezoid of acceleration, m/s2, one value a step, shape (n,).

    peak_mps2: its sign is kept. rise_mps3, fall_mps3: jerk into and out of the peak, m/s3. hold_s: at the peak, s.
    """
    size = abs(peak_mps2)
    rise = np.arange(step_s, size / rise_mps3, step_s) * rise_mps3
    fall = np.arange(step_s, size / fall_mps3, step_s) * fall_mps3
    return np.asarray(np.sign(peak_mps2) * np.concatenate([rise, np.full(round(hold_s / step_s), size), size - fall]))


def follow_profile(
    sumo: Any, vehicle: str, accelerations: Array, step_s: float, least_mps: float, most_mps: float
) -> Steps:
    """Follow a profile of acceleration, m/s2, and end at zero acceleration.

    The profile is cut short where the speed would leave least_mps to most_mps. It is entered from the driver's present
    acceleration, and left at a speed limit, at no more than `LARGEST_MPS3`.
    """
    sumo.vehicle.setSpeedMode(vehicle, UNCHECKED_SPEED_MODE)
    speed = sumo.vehicle.getSpeed(vehicle)
    present = sumo.vehicle.getAcceleration(vehicle)
    change = LARGEST_MPS3 * step_s
    for wanted in accelerations:
        # The speed that is reached if the acceleration goes to zero at the largest jerk from here on.
        reached = speed + present * abs(present) / (2.0 * LARGEST_MPS3)
        if reached <= least_mps or reached >= most_mps:
            break
        present += min(max(float(wanted) - present, -change), change)
        speed = max(0.0, speed + present * step_s)
        sumo.vehicle.setSpeed(vehicle, speed)
        yield
    while abs(present) > 1e-9:
        present -= min(max(present, -change), change)
        speed = max(0.0, speed + present * step_s)
        sumo.vehicle.setSpeed(vehicle, speed)
        yield


def release(sumo: Any, vehicle: str, step_s: float, ask: Ask | None = None) -> Steps:
    """Give the speed back to the driver without a jump.

    A driver that is released at once below its desired speed takes its full acceleration in one step. So the vehicle
    first coasts down to its desired speed if it is above, and then may accelerate more and more over `RELEASE_S`, until
    the driver wants no more than that. The driver keeps its distance to the leader all the while. ask: sets a speed,
    by default SUMO's command.
    """
    ask = ask or sumo.vehicle.setSpeed
    driver_mps2 = sumo.vehicle.getAccel(vehicle)
    sumo.vehicle.setSpeedMode(vehicle, DEFAULT_SPEED_MODE)
    yield from coast(sumo, vehicle, sumo.vehicle.getSpeedFactor(vehicle), step_s, ask)
    speed = sumo.vehicle.getSpeed(vehicle)
    for share in np.linspace(0.0, 1.0, round(RELEASE_S / step_s))[1:]:
        speed = min(speed, sumo.vehicle.getSpeed(vehicle)) + share * driver_mps2 * step_s
        ask(vehicle, speed)
        yield
    sumo.vehicle.setSpeed(vehicle, -1)


def restore(sumo: Any, vehicle: str, speed_factor: float) -> None:
    """Give a vehicle that stands beside the road back to its driver at once. speed_factor: the driver's own."""
    sumo.vehicle.setSpeedMode(vehicle, DEFAULT_SPEED_MODE)
    sumo.vehicle.setLaneChangeMode(vehicle, DEFAULT_LANE_CHANGE_MODE)
    sumo.vehicle.setSpeedFactor(vehicle, speed_factor)
    sumo.vehicle.setSpeed(vehicle, -1)


def coast(sumo: Any, vehicle: str, factor: float, step_s: float, ask: Ask | None = None) -> Steps:
    """Set a driver's speed factor, and slow a vehicle that is above the resulting desired speed at `COAST_MPS2`.

    Left alone, a driver above the desired speed brakes as hard as before an obstacle. The driver keeps its distance to
    the leader. ask: as in `release`.
    """
    ask = ask or sumo.vehicle.setSpeed
    sumo.vehicle.setSpeedFactor(vehicle, factor)
    desired = sumo.vehicle.getAllowedSpeed(vehicle)
    speed = sumo.vehicle.getSpeed(vehicle)
    if speed > desired:
        match_speed_factor(sumo, vehicle)
    while speed > desired:
        speed = min(speed, sumo.vehicle.getSpeed(vehicle)) - COAST_MPS2 * step_s
        ask(vehicle, speed)
        yield
    sumo.vehicle.setSpeedFactor(vehicle, factor)
    sumo.vehicle.setSpeed(vehicle, -1)


def match_speed_factor(sumo: Any, vehicle: str) -> None:
    """Make the desired speed one hundredth higher than the present speed, so that the driver stays near it."""
    factor = sumo.vehicle.getSpeedFactor(vehicle)
    present = sumo.vehicle.getSpeed(vehicle) / sumo.vehicle.getAllowedSpeed(vehicle)
    sumo.vehicle.setSpeedFactor(vehicle, float(max(1.01 * present * factor, LEAST_SPEED_FACTOR)))


def fade_speed_factor(sumo: Any, vehicle: str, end: float, over_s: float, step_s: float) -> Steps:
    """Move a driver's speed factor to another value in small steps over a time, s."""
    for factor in np.linspace(sumo.vehicle.getSpeedFactor(vehicle), end, 1 + round(over_s / step_s))[1:]:
        sumo.vehicle.setSpeedFactor(vehicle, factor)
        yield


def change_lane(
    sumo: Any, vehicle: str, direction: int, patience_s: float, step_s: float
) -> Generator[None, None, bool]:
    """Request the next lane until the vehicle's middle is in it. Returns whether it got there.

    direction: +1 towards the faster lanes, -1 towards the slower ones. patience_s: how long to wait for it, s.
    The request is withdrawn once the middle is across: while it stands, SUMO stops the lateral motion as soon as the
    whole body is in the lane, and the driver cannot move on to the lane's middle.
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


def wait(duration_s: float, step_s: float) -> Steps:
    """Send nothing for a time, s."""
    for _ in range(round(duration_s / step_s)):
        yield


def let_stops_last(sumo: Any, vehicles: Iterable[str], step_s: float) -> None:
    """Give vehicles that have just stopped beside the road (`parking="true"`, a parking area) their whole stop.

    SUMO 1.28 counts a whole action step of such a stop in every step: with steps of 10 ms and action steps of 0.1 s, a
    stop of 30 s ends after 3 s, and one until a given time ends after a tenth of the time that is left. What is left of
    it when it begins is therefore set to as many action steps as steps are meant.

    sumo: the running libsumo module. step_s: of the simulation, s.
    """
    for vehicle in vehicles:
        longer = sumo.vehicle.getActionStepLength(vehicle) / step_s
        left_s = sumo.vehicle.getStops(vehicle, 1)[0].duration
        if longer > 1.0 and left_s > 0.0:
            sumo.vehicle.setStopParameter(vehicle, 0, "duration", f"{left_s * longer:.3f}")
