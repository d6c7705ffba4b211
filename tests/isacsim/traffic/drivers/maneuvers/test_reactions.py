"""Maneuvers of the driver model, on SUMO's vehicles: they do what they are for, within what a car can do."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import Driver, DriverSettings, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris, VehicleAhead
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import DEFAULT_LANE_CHANGE_MODE, DEFAULT_SPEED_MODE
from isac_cosim.isacsim.traffic.drivers.maneuvers.brisk_start import BriskStart, BriskStartSettings
from isac_cosim.isacsim.traffic.drivers.maneuvers.evasion import Evasion, EvasionPlan
from isac_cosim.isacsim.traffic.drivers.maneuvers.hard_accel import Surge
from isac_cosim.isacsim.traffic.drivers.maneuvers.hard_brake import BrakeCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import ManeuverCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.swerve import SwerveCommand
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, session
from tests.support.roads import straight_road, vehicle

STEP = 0.01


def person(seed: int) -> tuple[Driver, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return draw_driver(DriverSettings(), rng), rng


@pytest.fixture(scope="module")
def lone(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load(straight_road(tmp_path_factory.mktemp("lone") / "lone0", vehicle("a")))


@contextmanager
def driving(scenario: Scenario, before_s: float = 5.0) -> Iterator[Any]:
    with session(scenario, 1, TrafficSettings()) as sumo:
        for _ in range(round(before_s / STEP)):
            sumo.simulationStep()
        yield sumo


def play(sumo: Any, maneuver: ManeuverCommand, after_s: float = 3.0, also: Any = None) -> SimpleNamespace:
    """Do the maneuver and drive on; return the series and the vehicle's modes before and after.

    also: steps of another vehicle, sent at the same time.
    """

    def modes() -> tuple[Any, ...]:
        get = sumo.vehicle
        factor, accel = round(get.getSpeedFactor("a"), 9), round(get.getAccel("a"), 9)
        return get.getSpeedMode("a"), get.getLaneChangeMode("a"), factor, accel

    before, rows, lanes, steps = modes(), [], [], maneuver.steps(sumo, STEP)
    count, after = 0, None
    while count < 6000:
        if after is None and next(steps, "over") == "over":
            after = modes()
            end = count
        if after is not None and count >= end + after_s / STEP:
            break
        if also is not None:
            next(also, None)
        sumo.simulationStep()
        count += 1
        rows.append((sumo.vehicle.getSpeed("a"), *sumo.vehicle.getPosition("a")))
        lanes.append(sumo.vehicle.getLaneIndex("a"))
    speed, x, y = np.array(rows).T
    assert before == after
    assert before[:2] == (DEFAULT_SPEED_MODE, DEFAULT_LANE_CHANGE_MODE)
    return SimpleNamespace(
        speed=speed, x=x, y=y, n=end, lanes=np.array(lanes),
        along=condition(speed, STEP, 0.15, 1), across=condition(y, STEP, 0.15, 2),
    )  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_brake_takes_away_the_speed_it_is_for(lone: Scenario, seed: int) -> None:
    with driving(lone) as sumo:
        before = sumo.vehicle.getSpeed("a")
        seen = play(sumo, BrakeCommand("a", 6.0, 0.0, 10.0, 5.0, *person(seed)), after_s=0.0)
    assert seen.speed.min() == pytest.approx(before - 10.0, abs=1.5)
    assert -8.0 < seen.along.min() < -4.0
    assert np.abs(condition(seen.speed, STEP, 0.15, 2)).max() < 25.0


def test_a_brake_that_rises_is_hard_later_and_takes_away_more_speed(lone: Scenario) -> None:
    """Half the peak after half the time, but for the lags; it takes half of peak times rise beside the drop."""
    driver, rng = person(4)
    exact = replace(driver, noise_share=0.0, correction_s=0.05, pedal_lag_s=0.1)
    with driving(lone) as sumo:
        before = sumo.vehicle.getSpeed("a")
        seen = play(sumo, BrakeCommand("a", 5.0, 2.0, 6.0, 3.0, exact, rng), after_s=0.0)
    np.testing.assert_allclose(seen.along[[75, 125, 175]], [-1.37, -2.62, -3.87], atol=0.3)
    assert seen.along.min() == pytest.approx(-5.0, abs=0.2)
    assert seen.speed.min() == pytest.approx(before - 11.0, abs=1.5)


def test_two_people_do_not_brake_alike(lone: Scenario) -> None:
    series = []
    for seed in (1, 2):
        with driving(lone) as sumo:
            series.append(play(sumo, BrakeCommand("a", 6.0, 0.0, 10.0, 5.0, *person(seed)), after_s=0.0).along[:250])
    assert np.abs(series[0] - series[1]).max() > 0.5


@pytest.mark.parametrize("seed", [1, 2])
def test_a_surge_reaches_its_goal_within_engine_power(lone: Scenario, seed: int) -> None:
    with driving(lone) as sumo:
        goal = sumo.vehicle.getSpeed("a") + 6.0
        surge = Surge("a", goal, 4.0, 110.0, 0.8, *person(seed), reason="gap_ahead")
        seen = play(sumo, surge)
    assert seen.speed.max() == pytest.approx(goal, abs=1.0)
    assert 2.5 < seen.along.max() < 4.8
    assert (seen.along * seen.speed).max() < 110.0 * 1.2
    assert (surge.cause, surge.ttc_s) == ("gap_ahead", None)


def test_a_surge_ends_behind_the_vehicle_ahead(tmp_path: Path) -> None:
    cars = vehicle("b", lane=1, position=90.0, speed=20.0) + vehicle("a", lane=1, position=20.0, speed=20.0)
    with session(load(straight_road(tmp_path / "two", cars)), 1, TrafficSettings()) as sumo:
        sumo.simulationStep()
        sumo.vehicle.setMaxSpeed("b", 20.0)
        sumo.vehicle.setLaneChangeMode("a", 512)
        gaps = []
        for _ in Surge("a", 32.0, 4.0, 120.0, 0.8, *person(1)).steps(sumo, STEP):
            sumo.simulationStep()
            gaps.append(sumo.vehicle.getLeader("a", 200.0)[1])
        assert min(gaps) > 5.0
        assert not sumo.simulation.getCollisions()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_swerve_goes_aside_and_comes_back(lone: Scenario, side: float) -> None:
    with driving(lone) as sumo:
        seen = play(sumo, SwerveCommand("a", side * 1.4, 6.0, 0.3, *person(4)))
    moved = side * (seen.y - seen.y[0])
    assert 1.2 < moved.max() < 1.9
    assert abs(moved[-1]) < 0.1
    assert 2.0 < np.abs(seen.across).max() < 7.0
    assert np.abs(np.diff(seen.across)).max() / STEP < 25.0


@pytest.mark.parametrize(("allowed", "lanes"), [([], {1, 2}), (["bicycle"], {1})])
def test_a_swerve_over_a_closed_lane_belongs_to_its_own(lone: Scenario, allowed: list[str], lanes: set[int]) -> None:
    """The way is the same either way; only an open lane takes the vehicle in while it is there."""
    with driving(lone) as sumo:
        edge, index = sumo.vehicle.getLaneID("a").rsplit("_", 1)
        sumo.lane.setAllowed(f"{edge}_{int(index) + 1}", allowed)
        seen = play(sumo, SwerveCommand("a", 2.4, 6.0, 0.3, *person(4)))
    assert 2.0 < (seen.y - seen.y[0]).max() < 2.9
    assert np.abs(np.diff(seen.y)).max() < 4.0 * STEP
    assert set(seen.lanes) == lanes


@pytest.mark.parametrize("stays", [False, True])
def test_debris_is_passed_beside_it(lone: Scenario, stays: bool) -> None:
    """The vehicle is aside when it gets there, and back afterwards, or in the next lane."""
    with driving(lone) as sumo:
        at = sumo.vehicle.getLanePosition("a") + 3.2 * sumo.vehicle.getSpeed("a")
        debris = Debris(sumo.vehicle.getLaneID("a"), at, -0.2, 0.4, 1e9)
        plan = EvasionPlan(brakes=True, aside_m=3.6 if stays else 1.5, stays=stays, pass_share=0.7)
        x0 = sumo.vehicle.getPosition("a")[0]
        before, start_m = sumo.vehicle.getSpeed("a"), sumo.vehicle.getLanePosition("a")
        evasion = Evasion("a", debris, plan, *person(5), inattentive=False)
        seen = play(sumo, evasion)
    there = int(np.argmax(seen.x - x0 > at - start_m))
    moved = seen.y - seen.y[0]
    assert moved[there] > 1.0
    assert (moved[-1] > 3.2) if stays else (abs(moved[-1]) < 0.3)
    assert set(seen.lanes) == ({1, 2} if stays else {1})
    assert seen.speed[there] < 0.85 * before
    assert np.abs(np.diff(seen.y)).max() < 4.0 * STEP
    assert np.hypot(seen.along, seen.across).max() < 9.0
    assert evasion.cause == "debris"
    assert evasion.ttc_s is not None
    assert 1.2 < evasion.ttc_s < 3.2 - evasion.driver.reaction_s + 0.3


def test_an_inattentive_driver_brakes_late_for_a_braking_leader(tmp_path: Path) -> None:
    """It rolls on while the vehicle ahead already brakes; then it brakes in time."""
    cars = vehicle("b", lane=1, position=60.0, speed=25.0) + vehicle("a", lane=1, position=20.0, speed=25.0)
    with session(load(straight_road(tmp_path / "two", cars)), 1, TrafficSettings()) as sumo:
        for _ in range(100):
            sumo.simulationStep()
        evasion = Evasion("a", VehicleAhead("b"), EvasionPlan(brakes=True), *person(6), inattentive=True)
        brake = BrakeCommand("b", 6.0, 0.0, 14.0, 3.0, *person(7)).steps(sumo, STEP)
        seen = play(sumo, evasion, after_s=0.0, also=brake)
        assert not sumo.simulation.getCollisions()
    rolls = round((evasion.driver.reaction_s + evasion.driver.look_away_s) / STEP)
    assert np.abs(seen.along[60 : rolls - 10]).max() < 0.6
    assert seen.along.min() < -3.0
    assert evasion.cause == "braking_leader"
    assert evasion.ttc_s is None or evasion.ttc_s < 8.0


def test_without_need_nobody_reacts(tmp_path: Path) -> None:
    cars = vehicle("b", lane=1, position=90.0, speed=25.0) + vehicle("a", lane=1, position=20.0, speed=20.0)
    with session(load(straight_road(tmp_path / "two", cars)), 1, TrafficSettings()) as sumo:
        for _ in range(100):
            sumo.simulationStep()
        evasion = Evasion("a", VehicleAhead("b"), EvasionPlan(brakes=True, aside_m=1.5), *person(6), inattentive=False)
        seen = play(sumo, evasion, after_s=0.0)
    assert (evasion.cause, evasion.ttc_s) == ("", None)
    assert np.ptp(seen.y) < 0.01


def test_a_brisk_start_uses_more_than_the_usual_acceleration(lone: Scenario) -> None:
    peaks = {}
    for peak in (0.5, 4.5):
        with driving(lone) as sumo:
            sumo.vehicle.setSpeed("a", 0.0)
            for _ in range(1500):
                sumo.simulationStep()
            start = BriskStart("a", peak, 4.0, BriskStartSettings())
            steps = start.steps(sumo, STEP)
            for _ in range(50):
                next(steps)
                sumo.simulationStep()
            sumo.vehicle.setSpeed("a", -1)
            speeds = []
            for _ in range(700):
                next(steps, None)
                sumo.simulationStep()
                speeds.append(sumo.vehicle.getSpeed("a"))
            peaks[peak] = condition(np.array(speeds), STEP, 0.15, 1).max()
            assert start.cause == "green_light"
    assert peaks[4.5] > 3.5 > 3.0 > peaks[0.5]
