"""What is drawn for each command: by default the documented ranges in a fixed order, otherwise what settings say."""

from typing import Any, cast

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.drivers import command_draws as draws
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
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import DriverSettings, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris, VehicleAhead
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_view import DriverView
from isac_cosim.isacsim.traffic.drivers.maneuvers import (
    CutInCommand,
    LaneChangeCommand,
    OvertakeCommand,
    SlowVehicleCommand,
    StopInLaneCommand,
)

PEOPLE, EVASION = DriverSettings(), EvasionSettings()
SEEDS = range(20)


class Surroundings:
    """A car at 20 m/s behind another at 18 m/s, with free lanes on both sides, unless told otherwise."""

    def __init__(self, **changes: Any) -> None:
        self.vehicle, self.leader = "a", "b"
        self.speed, self.leader_speed, self.allowed_speed, self.gap_m = 20.0, 18.0, 25.0, 46.0
        self.is_car, self.lane_width_m, self.width_m = True, 3.6, 1.8
        self.is_steady, self.lateral_m = True, 0.0
        self.lane, self.lane_position_m, self.lane_left_m = "e_1", 100.0, 900.0
        self.stands, self.room = False, {1: True, -1: True}
        self.beside = {1: 40.0, -1: 40.0}
        self.lanes = {1: True, -1: True}
        self.__dict__.update(changes)

    def has_lane(self, direction: int, stay_s: float) -> bool:
        return bool(self.lanes[direction]) and stay_s == 25.0

    def has_room_beside(self, direction: int, clear_m: float, ahead_s: float) -> bool:
        return bool(self.room[direction]) and (clear_m, ahead_s) in ((12.0, 3.0), (self.speed, 10.0))

    def stands_at_light(self, distance_m: float) -> bool:
        return self.stands and distance_m == 80.0

    def gap_beside_m(self, direction: int) -> float:
        return float(self.beside[direction])


def view(**changes: Any) -> DriverView:
    return cast(DriverView, Surroundings(**changes))


def rngs(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Two generators that give the same draws: one for the code, one to draw by hand, in the documented order."""
    return np.random.default_rng(seed), np.random.default_rng(seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_default_draws_are_these_in_this_order(seed: int) -> None:
    """Written out with plain numbers. Another number or order would change every recording of a seed."""
    rng, by_hand = rngs(seed)
    uniform = by_hand.uniform
    peak, log_rise, drop = by_hand.triangular(3.6, 3.6, 8.0), uniform(np.log(0.1), np.log(8.0)), uniform(4.0, 14.0)
    brake = draws.draw_brake(view(), BrakeCommandSettings(), PEOPLE, rng)
    assert brake is not None
    assert (brake.vehicle, brake.peak_mps2, brake.drop_mps, brake.floor_mps) == ("a", peak, drop, 5.0)
    assert brake.rise_s == pytest.approx(np.exp(log_rise), rel=1e-12)
    assert brake.driver == draw_driver(PEOPLE, by_hand)
    ends = ((2.8, 4.8), (80.0, 140.0), (5.0, 14.0), (0.4, 1.0), (1.0, 1.25))
    peak, power, gain, headway, impatience = (uniform(*pair) for pair in ends)
    goal = min(20.0 + gain, impatience * 30.0, 22.0 + (2.0 * 1.5 * (76.0 - 3.0 - headway * 20.0)) ** 0.5)
    fast = view(gap_m=76.0, allowed_speed=30.0, leader_speed=22.0)
    surge = draws.draw_surge(fast, AccelCommandSettings(), PEOPLE, rng, "gap_ahead")
    assert surge is not None
    assert (surge.goal_mps, surge.peak_mps2, surge.power_w_per_kg, surge.headway_s) == (goal, peak, power, headway)
    assert surge.driver == draw_driver(PEOPLE, by_hand)
    start = draws.draw_brisk_start(view(stands=True), BriskStartSettings(), rng)
    assert start is not None
    assert (start.peak_mps2, start.lasts_s) == (uniform(3.0, 4.8), uniform(3.0, 6.0))
    gain, clearance = max(1.0, (18.0 + uniform(5.0, 9.0)) / 25.0), uniform(8.0, 22.0)
    overtake = draws.draw_overtake(view(), OvertakeCommandSettings(), rng, 25.0, ())
    assert overtake == OvertakeCommand("a", "b", gain, clearance, OvertakeCommandSettings())
    offset, side = uniform(0.9, 1.7), by_hand.choice([1, -1])
    swerve = draws.draw_swerve(view(), SwerveCommandSettings(), EVASION, PEOPLE, rng)
    assert swerve is not None
    assert (swerve.offset_m, swerve.peak_mps2, swerve.hold_s) == (side * offset, uniform(4.0, 7.0), uniform(0.0, 0.8))
    assert swerve.driver == draw_driver(PEOPLE, by_hand)
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
    """Each command just beyond each of its limits; some draw before their last limits are looked at."""
    rng, untouched = rngs(1)
    assert draws.draw_brake(view(speed=14.0), BrakeCommandSettings(), PEOPLE, rng) is None
    for changes in ({"speed": 5.0}, {"is_car": False}):
        assert draws.draw_surge(view(**changes), AccelCommandSettings(), PEOPLE, rng, "") is None
    for changes in ({}, {"stands": True, "is_car": False}):
        assert draws.draw_brisk_start(view(**changes), BriskStartSettings(), rng) is None
    for changes in ({"speed": 8.0}, {"is_steady": False}):
        assert draws.draw_debris_evasion(view(**changes), DEBRIS, EVASION, PEOPLE, rng, 25.0) is None
        assert draws.draw_answer(view(**changes), VehicleAhead("b"), EVASION, PEOPLE, rng, 25.0) is None
    assert draws.draw_debris(view(speed=8.0), EVASION, rng, 0.0) is None
    for changes in ({"lanes": {1: False, -1: True}}, {"room": {1: False, -1: True}}):
        assert draws.draw_lane_change(view(**changes), LaneChangeCommandSettings(), 1, 25.0) is None
    for changes in ({"leader": None}, {"is_car": False}, {"lanes": {1: False, -1: True}}):
        assert draws.draw_overtake(view(**changes), OvertakeCommandSettings(), rng, 25.0, ()) is None
    blocked = {"room": {1: False, -1: False}}
    for changes in ({"speed": 10.0}, {"is_car": False}, {"is_steady": False}, blocked):
        assert draws.draw_swerve(view(**changes), SwerveCommandSettings(), EVASION, PEOPLE, rng) is None
    assert draws.draw_slow_vehicle(view(speed=15.0), SlowVehicleCommandSettings(), rng) is None
    tight = {1: 12.0, -1: 12.0}
    for changes in ({"speed": 8.0, "beside": tight}, {"lanes": {1: False, -1: False}, "beside": tight}, {}):
        assert draws.draw_cut_in(view(**changes), CutInCommandSettings(), 25.0) is None
    assert rng.random() == untouched.random()
    for changes in ({"gap_m": 10.0}, {"allowed_speed": 19.0}):
        assert draws.draw_surge(view(**changes), AccelCommandSettings(), PEOPLE, rng, "") is None
    for changes in ({"lane_left_m": 30.0}, {"gap_m": 15.0}):
        assert draws.draw_debris(view(**changes), EVASION, rng, 0.0) is None
    for changes in ({"gap_m": 16.0}, {"gap_m": 50.0}, {"leader_speed": 30.0}):
        assert draws.draw_overtake(view(**changes), OvertakeCommandSettings(), rng, 25.0, ()) is None
    assert draws.draw_overtake(view(), OvertakeCommandSettings(), rng, 25.0, {"b"}) is None


def test_draws_stay_within_ranges_that_are_set() -> None:
    rng = np.random.default_rng(7)
    brakes = BrakeCommandSettings(
        peak_mps2=(2.0, 2.5), rise_s=(0.0, 0.5), drop_mps=(3.0, 3.0), floor_mps=9.0, least_speed_mps=1.0
    )
    for _ in range(200):
        brake = draws.draw_brake(view(speed=2.0), brakes, PEOPLE, rng)
        assert brake is not None
        assert 2.0 <= brake.peak_mps2 <= 2.5
        assert 0.05 <= brake.rise_s <= 0.5
        assert (brake.drop_mps, brake.floor_mps) == (3.0, 9.0)


def test_brakes_at_once_and_changes_anywhere_are_those_of_earlier_versions() -> None:
    """With the settings that `as_stored` gives to earlier studies: no further draw, and no look at the room beside."""
    rng, by_hand = rngs(5)
    brake = draws.draw_brake(view(), BrakeCommandSettings(rise_s=(0.0, 0.0)), PEOPLE, rng)
    assert brake is not None
    assert brake.rise_s == 0.0
    assert (brake.peak_mps2, brake.drop_mps) == (by_hand.triangular(3.6, 3.6, 8.0), by_hand.uniform(4.0, 14.0))
    beset = view(room={1: False, -1: False})
    assert draws.draw_lane_change(beset, LaneChangeCommandSettings(clear_s=0.0), 1, 25.0) is not None


@pytest.mark.parametrize(("width_m", "largest_m"), [(3.6, 1.7), (3.2, 1.5), (2.6, 1.2)])
def test_a_swerve_stays_in_its_lane_however_narrow(width_m: float, largest_m: float) -> None:
    rng = np.random.default_rng(3)
    wide = SwerveCommandSettings(offset_m=(1.4, 1.7))
    for settings, least_m in ((SwerveCommandSettings(), 0.9), (wide, min(1.4, largest_m))):
        narrow = view(lane_width_m=width_m)
        swerves = [draws.draw_swerve(narrow, settings, EVASION, PEOPLE, rng) for _ in range(100)]
        offsets = [abs(swerve.offset_m) for swerve in swerves if swerve is not None]
        assert len(offsets) == 100
        assert least_m - 1e-12 <= min(offsets) <= max(offsets) <= largest_m + 1e-12


def test_debris_comes_into_view_a_few_seconds_ahead_and_behind_the_leader() -> None:
    rng = np.random.default_rng(4)
    for gap_m in (500.0, 46.0):
        seen = [draws.draw_debris(view(gap_m=gap_m), EVASION, rng, 10.0) for _ in range(200)]
        ahead = [debris.at_m - 100.0 for debris in seen if debris is not None]
        assert len(ahead) == 200
        assert min(ahead) >= min(2.2 * 20.0, gap_m)
        assert max(ahead) <= min(4.0 * 20.0, gap_m)
        assert all(
            debris is not None and debris.until > 10.0 + ahead_m / 20.0 - 1e-9
            for debris, ahead_m in zip(seen, ahead, strict=True)
        )


DEBRIS = Debris("e_1", 160.0, 0.3, 0.4, 20.0)


def test_debris_is_passed_on_the_nearer_side_with_clearance() -> None:
    """It lies 0.3 m to the left: half the car, half of it and the margin to the right, less what is there already."""
    rng = np.random.default_rng(5)
    drawn = [draws.draw_debris_evasion(view(), DEBRIS, EVASION, PEOPLE, rng, 25.0) for _ in range(300)]
    plans = [evasion.plan for evasion in drawn if evasion is not None]
    steered = [plan for plan in plans if plan.aside_m]
    within = [plan.aside_m for plan in steered if not plan.stays]
    assert -(0.9 + 0.4 + 0.5 - 0.3) <= min(within) < max(within) <= -(0.9 + 0.4 + 0.1 - 0.3)
    assert {plan.aside_m for plan in steered if plan.stays} == {-3.6}
    assert all(plan.brakes for plan in plans if not plan.aside_m)
    assert 0.6 < len(steered) / len(plans) < 0.9
    assert 0.1 < sum(plan.stays for plan in steered) / len(steered) < 0.3
    assert not any(evasion.inattentive for evasion in drawn if evasion is not None)


@pytest.mark.parametrize(
    ("changes", "asides"),
    [
        ({"room": {1: True, -1: False}}, (1.7, 2.1)),
        ({"room": {1: False, -1: False}}, (0.0, 0.0)),
        ({"is_car": False}, (0.0, 0.0)),
        ({"lanes": {1: False, -1: False}, "lane_width_m": 2.4}, (-1.1, -1.1)),
    ],
)
def test_where_there_is_no_room_drivers_go_elsewhere_or_brake(
    changes: dict[str, Any], asides: tuple[float, float]
) -> None:
    rng, settings = np.random.default_rng(6), EVASION.model_copy(update={"steer_share": 1.0, "stay_share": 0.0})
    for _ in range(50):
        evasion = draws.draw_debris_evasion(view(**changes), DEBRIS, settings, PEOPLE, rng, 25.0)
        assert evasion is not None
        assert asides[0] - 1e-9 <= evasion.plan.aside_m <= asides[1] + 1e-9
        assert evasion.plan.brakes or evasion.plan.aside_m


def test_an_answer_to_a_vehicle_ahead_always_brakes() -> None:
    rng = np.random.default_rng(7)
    answers = [draws.draw_answer(view(), VehicleAhead("b"), EVASION, PEOPLE, rng, 25.0) for _ in range(50)]
    assert all(answer is not None and answer.inattentive and answer.plan.brakes for answer in answers)
    assert {answer.plan.steer_ttc_s for answer in answers if answer is not None} == {2.2}
