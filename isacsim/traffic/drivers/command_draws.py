"""Commands with drawn parameters: each function returns one, or None where the surroundings do not allow it.

Ranges and limits come from `command_settings`. The order of the draws is part of what a seed means: a
change of it changes every recording.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from isac_cosim.isacsim.traffic.drivers.command_settings import (
    AccelCommandSettings,
    BrakeCommandSettings,
    BriskStartSettings,
    CutInCommandSettings,
    EvasionSettings,
    LaneChangeCommandSettings,
    OvertakeCommandSettings,
    SlowVehicleCommandSettings,
    StopInLaneCommandSettings,
    SwerveCommandSettings,
)
from isac_cosim.isacsim.traffic.drivers.driver_model import DriverSettings, draw_driver
from isac_cosim.isacsim.traffic.drivers.hazards import Debris, VehicleAhead
from isac_cosim.isacsim.traffic.drivers.maneuvers import (
    CutInCommand,
    LaneChangeCommand,
    OvertakeCommand,
    SlowVehicleCommand,
    StopInLaneCommand,
)
from isac_cosim.isacsim.traffic.drivers.reactions import (
    CLOSING_MPS2,
    STANDSTILL_M,
    BrakeCommand,
    BriskStart,
    Evasion,
    EvasionPlan,
    Surge,
    SwerveCommand,
)
from isac_cosim.isacsim.traffic.drivers.vehicle_view import DriverView

FASTER, SLOWER = 1, -1
"""Directions, as SUMO counts lanes: towards the faster lanes, which lie to the left where traffic keeps right and to
the right where it keeps left, and towards the slower ones. SUMO calls them left and right in either case."""


LEAST_NOTICE_S = 1.0
"""Debris closer than this, in time, is not evaded any more, s."""
SHORTEST_RISE_S = 0.05
"""Lower end of a range of rise times, where the range begins below it, s: it has a logarithm."""


def draw_brake(
    view: DriverView, settings: BrakeCommandSettings, people: DriverSettings, rng: np.random.Generator
) -> BrakeCommand | None:
    """Return a brake for a vehicle that is fast enough."""
    if view.speed <= settings.least_speed_mps:
        return None
    low, high = settings.peak_mps2
    peak = rng.triangular(low, low, high) if high > low else low
    low, high = settings.rise_s
    rise = np.exp(rng.uniform(*np.log(np.maximum([low, high], SHORTEST_RISE_S)))) if high > low else low
    drop = rng.uniform(*settings.drop_mps)
    return BrakeCommand(view.vehicle, peak, rise, drop, settings.floor_mps, draw_driver(people, rng), rng.spawn(1)[0])


def draw_surge(
    view: DriverView, settings: AccelCommandSettings, people: DriverSettings, rng: np.random.Generator, reason: str
) -> Surge | None:
    """Return an acceleration for a car that has room for it. reason: the cause to note, may be empty."""
    speed = view.speed
    if speed <= settings.least_speed_mps or not view.is_car:
        return None
    peak, power, gain, headway, impatience = (
        rng.uniform(*ends)
        for ends in (
            settings.peak_mps2,
            settings.power_w_per_kg,
            settings.gain_mps,
            settings.headway_s,
            settings.impatience_gain,
        )
    )
    goal = min(speed + gain, impatience * view.allowed_speed)
    if view.leader is not None:
        # The speed from which the driver can still close in without braking hard.
        room = max(0.0, view.gap_m - STANDSTILL_M - headway * speed)
        goal = min(goal, view.leader_speed + (2.0 * CLOSING_MPS2 * room) ** 0.5)
    if goal < speed + settings.least_gain_mps:
        return None
    return Surge(view.vehicle, goal, peak, power, headway, draw_driver(people, rng), rng.spawn(1)[0], reason)


def draw_brisk_start(view: DriverView, settings: BriskStartSettings, rng: np.random.Generator) -> BriskStart | None:
    """Return a hard start for a car that stands at a traffic light."""
    if not view.is_car or not view.stands_at_light(settings.within_m):
        return None
    return BriskStart(view.vehicle, rng.uniform(*settings.peak_mps2), rng.uniform(*settings.lasts_s), settings)


def draw_debris(view: DriverView, settings: EvasionSettings, rng: np.random.Generator, time: float) -> Debris | None:
    """Return debris that comes into a vehicle's view, behind the vehicle ahead. time: now, s."""
    if view.speed <= settings.least_speed_mps:
        return None
    # What the vehicle ahead hides comes into view where that vehicle is now.
    ahead_m = min(rng.uniform(*settings.notice_ttc_s) * view.speed, view.gap_m)
    lateral, half_width, lies_s = (
        rng.uniform(*ends) for ends in (settings.debris_lateral_m, settings.debris_half_width_m, settings.lies_s)
    )
    if ahead_m > view.lane_left_m or ahead_m < LEAST_NOTICE_S * view.speed:
        return None
    return Debris(view.lane, view.lane_position_m + ahead_m, lateral, half_width, time + ahead_m / view.speed + lies_s)


def draw_debris_evasion(
    view: DriverView,
    debris: Debris,
    settings: EvasionSettings,
    people: DriverSettings,
    rng: np.random.Generator,
    stay_s: float,
) -> Evasion | None:
    """Return how a driver answers to debris: steering where there is room, braking, or both."""
    if view.speed <= settings.least_speed_mps or not view.is_steady:
        return None
    away_m = view.lateral_m - debris.lateral_m
    clear_m = view.width_m / 2.0 + debris.half_width_m + rng.uniform(*settings.margin_m)
    near_side = FASTER if away_m >= 0.0 else SLOWER
    options = {near_side: clear_m - abs(away_m), -near_side: clear_m + abs(away_m)}
    aside, stays = 0.0, False
    if view.is_car and rng.random() < settings.steer_share:
        aside, stays = _aside(view, options, settings, rng, stay_s)
    brakes = not aside or rng.random() < settings.brake_share
    plan = EvasionPlan(brakes, aside, stays, pass_share=rng.uniform(*settings.pass_share))
    return Evasion(view.vehicle, debris, plan, draw_driver(people, rng), rng.spawn(1)[0], inattentive=False)


def draw_answer(
    view: DriverView,
    ahead: VehicleAhead,
    settings: EvasionSettings,
    people: DriverSettings,
    rng: np.random.Generator,
    stay_s: float,
) -> Evasion | None:
    """Return how an inattentive driver answers to a vehicle ahead: braking, and steering where time is short."""
    if view.speed <= settings.least_speed_mps or not view.is_steady:
        return None
    width_m = view.width_m + rng.uniform(*settings.margin_m)
    aside, stays = 0.0, False
    if view.is_car and rng.random() < settings.steer_share:
        aside, stays = _aside(view, {FASTER: width_m, SLOWER: width_m}, settings, rng, stay_s)
    plan = EvasionPlan(True, aside, stays, settings.steer_ttc_s)
    return Evasion(view.vehicle, ahead, plan, draw_driver(people, rng), rng.spawn(1)[0], inattentive=True)


def _aside(
    view: DriverView, options: dict[int, float], settings: EvasionSettings, rng: np.random.Generator, stay_s: float
) -> tuple[float, bool]:
    """Return how far a driver moves aside, m, 0 where there is no room, and whether it stays in the next lane.

    options: the distance that it takes to each side, m; the shorter is preferred.
    """
    within_lane_m = view.lane_width_m / 2.0 - settings.lane_margin_m
    stays = rng.random() < settings.stay_share
    for side, distance_m in sorted(options.items(), key=lambda option: option[1]):
        if view.has_room_beside(side, settings.clear_beside_m, settings.clear_beside_s):
            beside = view.has_lane(side, stay_s)
            if stays and beside:
                return side * view.lane_width_m, True
            return side * (distance_m if beside else min(distance_m, within_lane_m - side * view.lateral_m)), False
    return 0.0, False


def draw_lane_change(
    view: DriverView, settings: LaneChangeCommandSettings, direction: int, stay_s: float
) -> LaneChangeCommand | None:
    """Return a lane change where there is a lane and nobody has to slow down for it; nothing is drawn.

    direction: `FASTER` or `SLOWER`. stay_s: as for `DriverView.has_lane`.
    """
    if not view.has_lane(direction, stay_s):
        return None
    if settings.clear_s and not view.has_room_beside(direction, settings.headway_s * view.speed, settings.clear_s):
        return None
    return LaneChangeCommand(view.vehicle, direction, settings.patience_s)


def draw_overtake(
    view: DriverView,
    settings: OvertakeCommandSettings,
    rng: np.random.Generator,
    stay_s: float,
    commanded: Container[str],
) -> OvertakeCommand | None:
    """Return an overtake for a car close behind another vehicle, with a faster lane beside.

    commanded: vehicles under command, which are not overtaken. stay_s: as for `DriverView.has_lane`.
    """
    if view.leader is None or not view.is_car or not view.has_lane(FASTER, stay_s):
        return None
    gain = max(1.0, (view.leader_speed + rng.uniform(*settings.surplus_mps)) / view.allowed_speed)
    low, high = settings.headway_s
    close = low < view.gap_m / max(view.speed, 1.0) < high
    if not close or gain >= settings.largest_gain or view.leader in commanded:
        return None
    return OvertakeCommand(view.vehicle, view.leader, gain, rng.uniform(*settings.clearance_m), settings)


def draw_swerve(
    view: DriverView,
    settings: SwerveCommandSettings,
    evasion: EvasionSettings,
    people: DriverSettings,
    rng: np.random.Generator,
) -> SwerveCommand | None:
    """Return a swerve for a car with room beside; no further aside than its lane. evasion: the limits of room."""
    if not view.is_car or view.speed <= settings.least_speed_mps or not view.is_steady:
        return None
    clear = evasion.clear_beside_m, evasion.clear_beside_s
    sides = [side for side in (FASTER, SLOWER) if view.has_room_beside(side, *clear)]
    if not sides:
        return None
    low, high = settings.offset_m
    high = min(high, view.lane_width_m / 2.0 - evasion.lane_margin_m)
    offset = rng.uniform(min(low, high), high)
    side = float(rng.choice(sides))
    peak, hold = rng.uniform(*settings.peak_mps2), rng.uniform(*settings.hold_s)
    return SwerveCommand(view.vehicle, side * offset, peak, hold, draw_driver(people, rng), rng.spawn(1)[0])


def draw_slow_vehicle(
    view: DriverView, settings: SlowVehicleCommandSettings, rng: np.random.Generator
) -> SlowVehicleCommand | None:
    """Return a slow drive for a vehicle that is fast enough."""
    if view.speed <= settings.least_speed_mps:
        return None
    share, slow_s = rng.uniform(*settings.speed_share), rng.uniform(*settings.slow_s)
    return SlowVehicleCommand(view.vehicle, share, slow_s, settings)


def draw_stop_in_lane(
    view: DriverView, settings: StopInLaneCommandSettings, rng: np.random.Generator
) -> StopInLaneCommand:
    """Return a stop."""
    return StopInLaneCommand(view.vehicle, rng.uniform(*settings.stand_s), settings)


def draw_cut_in(view: DriverView, settings: CutInCommandSettings, stay_s: float) -> CutInCommand | None:
    """Return a cut-in, to the faster side where the gap there fits, otherwise to the slower; nothing is drawn.

    stay_s: as for `DriverView.has_lane`.
    """
    if view.speed <= settings.least_speed_mps:
        return None
    low, high = settings.gap_m
    for side in (FASTER, SLOWER):
        if view.has_lane(side, stay_s) and low < view.gap_beside_m(side) < high:
            return CutInCommand(view.vehicle, side, settings.patience_s)
    return None
