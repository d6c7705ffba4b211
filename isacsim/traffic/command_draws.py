"""Commands with drawn parameters: each function returns one, or None where the surroundings do not allow it.

Ranges and limits come from `isacsim.traffic.command_settings`. The order of the draws is part of what a seed means: a
change of it changes every recording.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from isacsim.traffic.command_settings import (
    AccelCommandSettings,
    BrakeCommandSettings,
    CutInCommandSettings,
    LaneChangeCommandSettings,
    OvertakeCommandSettings,
    SlowVehicleCommandSettings,
    StopInLaneCommandSettings,
    SwerveCommandSettings,
)
from isacsim.traffic.maneuvers import (
    AccelCommand,
    BrakeCommand,
    CutInCommand,
    LaneChangeCommand,
    OvertakeCommand,
    SlowVehicleCommand,
    StopInLaneCommand,
    SwerveCommand,
)
from isacsim.traffic.vehicle_view import VehicleView

FASTER, SLOWER = 1, -1
"""Directions, as SUMO counts lanes: towards the faster lanes, which lie to the left where traffic keeps right and to
the right where it keeps left, and towards the slower ones. SUMO calls them left and right in either case."""


def draw_brake(view: VehicleView, settings: BrakeCommandSettings, rng: np.random.Generator) -> BrakeCommand | None:
    """Return a brake for a vehicle that is fast enough."""
    if view.speed <= settings.least_speed_mps:
        return None
    peak = -rng.uniform(*settings.peak_mps2)
    rise, hold, fall = (rng.uniform(*ends) for ends in (settings.rise_mps3, settings.hold_s, settings.fall_mps3))
    return BrakeCommand(view.vehicle, peak, rise, hold, fall, settings.floor_mps)


def draw_accel(view: VehicleView, settings: AccelCommandSettings, rng: np.random.Generator) -> AccelCommand | None:
    """Return an acceleration for a car with a gap ahead that is long enough."""
    speed = view.speed
    headway_m = settings.clear_ahead_s * speed
    if speed <= settings.least_speed_mps or view.gap_m <= settings.clear_ahead_m + headway_m or not view.is_car:
        return None
    peak = rng.uniform(*(settings.peak_mps2 if speed < settings.fast_mps else settings.fast_peak_mps2))
    # The driver has to close in afterwards, in what is left of the gap, without braking hard.
    closing_mps = settings.closing_per_s * (view.gap_m - headway_m)
    top = max(speed + settings.least_at_peak_s * peak, min(settings.top_mps, view.leader_speed + closing_mps))
    rise, hold, fall = (rng.uniform(*ends) for ends in (settings.rise_mps3, settings.hold_s, settings.fall_mps3))
    return AccelCommand(view.vehicle, peak, rise, hold, fall, top)


def draw_lane_change(
    view: VehicleView, settings: LaneChangeCommandSettings, direction: int, stay_s: float
) -> LaneChangeCommand | None:
    """Return a lane change where there is a lane; nothing is drawn.

    direction: `FASTER` or `SLOWER`. stay_s: as for `VehicleView.has_lane`.
    """
    if not view.has_lane(direction, stay_s):
        return None
    return LaneChangeCommand(view.vehicle, direction, settings.patience_s)


def draw_overtake(
    view: VehicleView,
    settings: OvertakeCommandSettings,
    rng: np.random.Generator,
    stay_s: float,
    commanded: Container[str],
) -> OvertakeCommand | None:
    """Return an overtake for a car close behind another vehicle, with a faster lane beside.

    commanded: vehicles under command, which are not overtaken. stay_s: as for `VehicleView.has_lane`.
    """
    if view.leader is None or not view.is_car or not view.has_lane(FASTER, stay_s):
        return None
    gain = max(1.0, (view.leader_speed + rng.uniform(*settings.surplus_mps)) / view.allowed_speed)
    low, high = settings.headway_s
    close = low < view.gap_m / max(view.speed, 1.0) < high
    if not close or gain >= settings.largest_gain or view.leader in commanded:
        return None
    return OvertakeCommand(view.vehicle, view.leader, gain, rng.uniform(*settings.clearance_m), settings)


def draw_swerve(view: VehicleView, settings: SwerveCommandSettings, rng: np.random.Generator) -> SwerveCommand | None:
    """Return a swerve for a car with a vehicle ahead to evade and room beside; no further aside than its lane."""
    if not view.is_car or view.speed <= settings.least_speed_mps or view.gap_m >= settings.threat_within_m:
        return None
    sides = [side for side in (FASTER, SLOWER) if view.gap_beside_m(side) > settings.clear_beside_m]
    if not sides:
        return None
    low, high = settings.offset_m
    high = min(high, view.lane_width_m / 2.0 - settings.lane_margin_m)
    offset = rng.uniform(min(low, high), high)
    side = float(rng.choice(sides))
    peak, hold = rng.uniform(*settings.peak_mps2), rng.uniform(*settings.hold_s)
    return SwerveCommand(view.vehicle, side * offset, peak, hold)


def draw_slow_vehicle(
    view: VehicleView, settings: SlowVehicleCommandSettings, rng: np.random.Generator
) -> SlowVehicleCommand | None:
    """Return a slow drive for a vehicle that is fast enough."""
    if view.speed <= settings.least_speed_mps:
        return None
    share, slow_s = rng.uniform(*settings.speed_share), rng.uniform(*settings.slow_s)
    return SlowVehicleCommand(view.vehicle, share, slow_s, settings)


def draw_stop_in_lane(
    view: VehicleView, settings: StopInLaneCommandSettings, rng: np.random.Generator
) -> StopInLaneCommand:
    """Return a stop."""
    return StopInLaneCommand(view.vehicle, rng.uniform(*settings.stand_s), settings)


def draw_cut_in(view: VehicleView, settings: CutInCommandSettings, stay_s: float) -> CutInCommand | None:
    """Return a cut-in, to the faster side where the gap there fits, otherwise to the slower; nothing is drawn.

    stay_s: as for `VehicleView.has_lane`.
    """
    if view.speed <= settings.least_speed_mps:
        return None
    low, high = settings.gap_m
    for side in (FASTER, SLOWER):
        if view.has_lane(side, stay_s) and low < view.gap_beside_m(side) < high:
            return CutInCommand(view.vehicle, side, settings.patience_s)
    return None
