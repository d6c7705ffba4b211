"""What is drawn for each command: by default the documented ranges in a fixed order, otherwise what settings say."""

from typing import Any, cast

import numpy as np
import pytest

from isacsim.traffic import command_draws as draws
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

SEEDS = range(20)


class Surroundings:
    """A car at 20 m/s behind another at 18 m/s, with free lanes on both sides, unless told otherwise."""

    def __init__(self, **changes: Any) -> None:
        self.vehicle, self.leader = "a", "b"
        self.speed, self.leader_speed, self.allowed_speed, self.gap_m = 20.0, 18.0, 25.0, 46.0
        self.is_car, self.lane_width_m = True, 3.6
        self.beside = {1: 40.0, -1: 40.0}
        self.lanes = {1: True, -1: True}
        self.__dict__.update(changes)

    def has_lane(self, direction: int, stay_s: float) -> bool:
        return bool(self.lanes[direction]) and stay_s == 25.0

    def gap_beside_m(self, direction: int) -> float:
        return float(self.beside[direction])


def view(**changes: Any) -> VehicleView:
    return cast(VehicleView, Surroundings(**changes))


def rngs(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Two generators that give the same draws: one for the code, one to draw by hand, in the documented order."""
    return np.random.default_rng(seed), np.random.default_rng(seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_default_draws_are_these_in_this_order(seed: int) -> None:
    """Written out with plain numbers. Another number or order would change every recording of a seed."""
    rng, by_hand = rngs(seed)
    uniform = by_hand.uniform
    peak, rise, hold, fall = -uniform(4.8, 8.0), uniform(10.0, 18.0), uniform(0.6, 1.6), uniform(6.0, 12.0)
    brake = draws.draw_brake(view(), BrakeCommandSettings(), rng)
    assert brake == BrakeCommand("a", peak, rise, hold, fall, 5.0)
    for speed, (low, high) in ((20.0, (3.0, 4.5)), (26.0, (2.8, 3.5))):
        peak, rise, hold, fall = uniform(low, high), uniform(5.0, 10.0), uniform(1.4, 2.6), uniform(4.0, 8.0)
        top = max(speed + 1.7 * peak, min(44.0, 18.0 + 0.05 * (146.0 - 1.2 * speed)))
        accel = draws.draw_accel(view(speed=speed, gap_m=146.0), AccelCommandSettings(), rng)
        assert accel == AccelCommand("a", peak, rise, hold, fall, top)
    gain, clearance = max(1.0, (18.0 + uniform(5.0, 9.0)) / 25.0), uniform(8.0, 22.0)
    overtake = draws.draw_overtake(view(), OvertakeCommandSettings(), rng, 25.0, ())
    assert overtake == OvertakeCommand("a", "b", gain, clearance, OvertakeCommandSettings())
    offset = uniform(1.0, 1.7)
    side = by_hand.choice([1, -1])
    swerve = draws.draw_swerve(view(), SwerveCommandSettings(), rng)
    assert swerve == SwerveCommand("a", side * offset, uniform(4.5, 6.0), uniform(0.0, 0.6))
    slow = draws.draw_slow_vehicle(view(), SlowVehicleCommandSettings(), rng)
    assert slow == SlowVehicleCommand("a", uniform(0.65, 0.8), uniform(20.0, 40.0), SlowVehicleCommandSettings())
    stop = draws.draw_stop_in_lane(view(), StopInLaneCommandSettings(), rng)
    assert stop == StopInLaneCommand("a", uniform(15.0, 40.0), StopInLaneCommandSettings())
    change = draws.draw_lane_change(view(), LaneChangeCommandSettings(), -1, 25.0)
    assert change == LaneChangeCommand("a", -1, 8.0)
    cut_in = draws.draw_cut_in(view(beside={1: 30.0, -1: 12.0}), CutInCommandSettings(), 25.0)
    assert cut_in == CutInCommand("a", -1, 5.0)
    assert rng.random() == by_hand.random()


def test_nothing_is_drawn_where_the_surroundings_do_not_allow_it() -> None:
    """Each command just beyond each of its limits; only an overtake draws before its last limits are looked at."""
    rng, untouched = rngs(1)
    assert draws.draw_brake(view(speed=14.0), BrakeCommandSettings(), rng) is None
    for changes in ({"speed": 5.0, "gap_m": 500.0}, {"gap_m": 44.0}, {"gap_m": 500.0, "is_car": False}):
        assert draws.draw_accel(view(**changes), AccelCommandSettings(), rng) is None
    assert draws.draw_lane_change(view(lanes={1: False, -1: True}), LaneChangeCommandSettings(), 1, 25.0) is None
    for changes in ({"leader": None}, {"is_car": False}, {"lanes": {1: False, -1: True}}):
        assert draws.draw_overtake(view(**changes), OvertakeCommandSettings(), rng, 25.0, ()) is None
    blocked = {"beside": {1: 15.0, -1: 15.0}}
    for changes in ({"speed": 10.0}, {"is_car": False}, {"gap_m": 90.0}, blocked):
        assert draws.draw_swerve(view(**changes), SwerveCommandSettings(), rng) is None
    assert draws.draw_slow_vehicle(view(speed=15.0), SlowVehicleCommandSettings(), rng) is None
    tight = {1: 12.0, -1: 12.0}
    for changes in ({"speed": 8.0, "beside": tight}, {"lanes": {1: False, -1: False}, "beside": tight}, {}):
        assert draws.draw_cut_in(view(**changes), CutInCommandSettings(), 25.0) is None
    assert rng.random() == untouched.random()
    for changes in ({"gap_m": 16.0}, {"gap_m": 50.0}, {"leader_speed": 30.0}):
        assert draws.draw_overtake(view(**changes), OvertakeCommandSettings(), rng, 25.0, ()) is None
    assert draws.draw_overtake(view(), OvertakeCommandSettings(), rng, 25.0, {"b"}) is None


def test_draws_stay_within_ranges_that_are_set() -> None:
    rng = np.random.default_rng(7)
    brakes = BrakeCommandSettings(peak_mps2=(2.0, 2.5), hold_s=(3.0, 3.0), floor_mps=9.0, least_speed_mps=1.0)
    for _ in range(200):
        brake = draws.draw_brake(view(speed=2.0), brakes, rng)
        assert brake is not None
        assert -2.5 <= brake.peak_mps2 <= -2.0
        assert (brake.hold_s, brake.floor_mps) == (3.0, 9.0)


@pytest.mark.parametrize(("width_m", "largest_m"), [(3.6, 1.7), (3.2, 1.5), (2.6, 1.2)])
def test_a_swerve_stays_in_its_lane_however_narrow(width_m: float, largest_m: float) -> None:
    rng = np.random.default_rng(3)
    wide = SwerveCommandSettings(offset_m=(1.4, 1.7))
    for settings, least_m in ((SwerveCommandSettings(), 1.0), (wide, min(1.4, largest_m))):
        swerves = [draws.draw_swerve(view(lane_width_m=width_m), settings, rng) for _ in range(100)]
        offsets = [abs(swerve.offset_m) for swerve in swerves if swerve is not None]
        assert len(offsets) == 100
        assert least_m - 1e-12 <= min(offsets) <= max(offsets) <= largest_m + 1e-12
