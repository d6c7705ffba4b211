"""Lane changes, overtakes and disturbances, on lone vehicles: the vehicle does it, and its release makes no jump."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import (
    DEFAULT_LANE_CHANGE_MODE,
    DEFAULT_SPEED_MODE,
    ramp_hold_ramp,
)
from isac_cosim.isacsim.traffic.drivers.maneuvers.closed_ramp_end import ClosedRampEndCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.cut_in import CutInCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import ManeuverCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.lane_change import LaneChangeCommand
from isac_cosim.isacsim.traffic.drivers.maneuvers.overtake import OvertakeCommand, OvertakeCommandSettings
from isac_cosim.isacsim.traffic.drivers.maneuvers.slow_vehicle import SlowVehicleCommand, SlowVehicleCommandSettings
from isac_cosim.isacsim.traffic.drivers.maneuvers.stop_in_lane import (
    StopInLaneCommand,
    StopInLaneCommandSettings,
    stopping_m,
)
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, session
from tests.support.roads import straight_road, vehicle

STEP = 0.01
OVERTAKE, SLOW, STOP = OvertakeCommandSettings(), SlowVehicleCommandSettings(), StopInLaneCommandSettings()


@pytest.fixture(scope="module")
def lone(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load(straight_road(tmp_path_factory.mktemp("lone") / "lone0", vehicle("a")))


@pytest.fixture(scope="module")
def ending(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Lane 0 ends; a vehicle in it, and others that follow in it and beside."""
    cars = [vehicle("a", 0.0, 0, 800.0, 20.0)]
    for k in range(1, 6):
        cars += [vehicle(f"f{k}", 2.5 * k, 0, 800.0, 20.0), vehicle(f"b{k}", 2.5 * k + 1.2, 1, 800.0, 20.0)]
    return load(straight_road(tmp_path_factory.mktemp("ending") / "ending0", "".join(cars), ending=True))


def lateral_jerk(y: np.ndarray) -> float:
    """The greatest lateral jerk of positions across a straight road after conditioning, m/s3."""
    return float(np.abs(np.diff(condition(y, STEP, 0.15, 2))).max() / STEP)


def play(scenario: Scenario, maneuver: ManeuverCommand, after_s: float = 3.0) -> dict[str, Any]:
    """Drive 5 s, do the maneuver, drive on; returns the raw series and the vehicle's modes before and after."""
    with session(scenario, 1, TrafficSettings()) as sumo:
        for _ in range(500):
            sumo.simulationStep()

        def settings() -> tuple[Any, ...]:
            return (
                sumo.vehicle.getSpeedMode("a"),
                sumo.vehicle.getLaneChangeMode("a"),
                round(sumo.vehicle.getSpeedFactor("a"), 9),
                round(sumo.vehicle.getAccel("a"), 9),
            )

        before, rows, steps = settings(), [], maneuver.steps(sumo, STEP)
        count = 0
        while next(steps, "over") != "over":
            sumo.simulationStep()
            count += 1
            rows.append((sumo.vehicle.getSpeed("a"), *sumo.vehicle.getPosition("a")))
        after = settings()
        for _ in range(round(after_s / STEP)):
            sumo.simulationStep()
            rows.append((sumo.vehicle.getSpeed("a"), *sumo.vehicle.getPosition("a")))
    speed, x, y = np.array(rows).T
    return {"speed": speed, "x": x, "y": y, "before": before, "after": after, "n": count}


@pytest.mark.parametrize("direction", [1, -1])
def test_a_lane_change_ends_in_the_middle_of_the_next_lane(lone: Scenario, direction: int) -> None:
    seen = play(lone, LaneChangeCommand("a", direction, 8.0))
    moved = seen["y"] - seen["y"][0]
    assert np.sign(moved[seen["n"]]) == direction
    assert np.abs(moved).max() == pytest.approx(3.6, abs=0.1)
    assert np.abs(np.diff(seen["y"])).max() < 1.5 * STEP
    assert lateral_jerk(seen["y"]) < 25.0
    assert seen["before"] == seen["after"]


def test_an_overtake_passes_and_comes_back(tmp_path: Path) -> None:
    scenario = load(
        straight_road(tmp_path / "two", vehicle("a", lane=0) + vehicle("slow", lane=0, position=60.0, speed=18.0))
    )
    with session(scenario, 1, TrafficSettings()) as sumo:
        sumo.simulationStep()
        sumo.vehicle.setSpeedFactor("slow", 0.5)
        for _ in range(400):
            sumo.simulationStep()
        before = (sumo.vehicle.getSpeedFactor("a"), sumo.vehicle.getSpeedMode("a"))
        lanes, y = [], []
        for _ in OvertakeCommand("a", "slow", 1.1, 12.0, OVERTAKE.model_copy(update={"pass_s": 30.0})).steps(
            sumo, STEP
        ):
            sumo.simulationStep()
            lanes.append(sumo.vehicle.getLaneIndex("a"))
            y.append(sumo.vehicle.getPosition("a")[1])
        ahead = sumo.vehicle.getPosition("a")[0] - sumo.vehicle.getLength("a") - sumo.vehicle.getPosition("slow")[0]
        assert max(lanes) == 1
        assert lanes[-1] == 0
        assert ahead > 12.0
        assert np.abs(np.diff(y)).max() < 1.5 * STEP
        assert lateral_jerk(np.array(y)) < 25.0
        assert (sumo.vehicle.getSpeedFactor("a"), sumo.vehicle.getSpeedMode("a")) == pytest.approx(before)
        assert sumo.vehicle.getLaneChangeMode("a") == DEFAULT_LANE_CHANGE_MODE
        assert sumo.vehicle.getSpeedFactor("slow") == pytest.approx(0.5)
        assert sumo.vehicle.getLaneChangeMode("slow") == DEFAULT_LANE_CHANGE_MODE


def test_a_slow_vehicle_slows_gently_and_recovers(lone: Scenario) -> None:
    seen = play(lone, SlowVehicleCommand("a", 0.7, 5.0, SLOW), after_s=6.0)
    assert seen["speed"].min() == pytest.approx(0.7 * seen["speed"][0], rel=0.05)
    assert condition(seen["speed"], STEP, 0.15, 1).min() > -1.2
    assert np.abs(condition(seen["speed"], STEP, 0.15, 2)).max() < 25.0
    assert seen["before"] == seen["after"]


PLACE_M, STANDS_S = 1350.0, 12.0


@pytest.mark.parametrize(
    "maneuver",
    [StopInLaneCommand("a", STANDS_S, STOP), ClosedRampEndCommand("a", "e0_0", PLACE_M, STANDS_S, 30.0, STOP)],
)
def test_a_stop_is_gentle_and_released_without_a_jump(ending: Scenario, maneuver: ManeuverCommand) -> None:
    seen = play(ending, maneuver)
    stands = seen["speed"] == 0.0
    assert STANDS_S <= stands.sum() * STEP < STANDS_S + 1.5
    if isinstance(maneuver, ClosedRampEndCommand):
        assert seen["x"][stands] == pytest.approx(PLACE_M, abs=2.0)
    assert condition(seen["speed"], STEP, 0.15, 1).min() == pytest.approx(-2.5, abs=0.2)
    assert np.abs(condition(seen["speed"], STEP, 0.15, 2)).max() < 25.0
    standing_from = int(np.flatnonzero(stands)[0])
    assert np.abs(np.diff(seen["speed"][standing_from:], 2)).max() / STEP < 0.5
    assert np.abs(np.diff(seen["y"])).max() < 1.5 * STEP
    assert seen["before"] == seen["after"]
    assert seen["after"][:2] == (DEFAULT_SPEED_MODE, DEFAULT_LANE_CHANGE_MODE)


def test_a_closed_ramp_end_that_is_out_of_reach_is_given_up(lone: Scenario) -> None:
    """The vehicle has left the lane, or does not get there in time: it drives on as before."""
    in_the_next_lane = ClosedRampEndCommand("a", "e0_0", 900.0, 5.0, 30.0, STOP)
    too_far = ClosedRampEndCommand("a", "e0_1", 900.0, 5.0, 2.0, STOP)
    for maneuver in (in_the_next_lane, too_far):
        seen = play(lone, maneuver)
        assert seen["speed"].min() > 20.0
        assert seen["before"] == seen["after"]


def test_vehicles_behind_a_closed_ramp_end_merge_before_it_by_themselves(ending: Scenario) -> None:
    with session(ending, 1, TrafficSettings()) as sumo:
        for _ in range(500):
            sumo.simulationStep()
        merged: dict[str, float] = {}
        for _ in ClosedRampEndCommand("a", "e0_0", PLACE_M, 40.0, 30.0, STOP).steps(sumo, STEP):
            sumo.simulationStep()
            for name in sumo.vehicle.getIDList():
                if name.startswith("f") and sumo.vehicle.getLaneIndex(name) > 0 and name not in merged:
                    merged[name] = sumo.vehicle.getPosition(name)[0]
        assert len(merged) == 5
        assert max(merged.values()) < PLACE_M
        assert not sumo.simulation.getCollisions()


def test_a_cut_in_is_smooth_and_makes_the_follower_slow_down(tmp_path: Path) -> None:
    cars = vehicle("b", lane=0, position=12.0) + vehicle("a", lane=1, position=30.0)
    with session(load(straight_road(tmp_path / "two", cars)), 1, TrafficSettings()) as sumo:
        sumo.simulationStep()
        sumo.vehicle.setMaxSpeed("a", 22.0)
        for _ in range(100):
            sumo.simulationStep()
        before = [sumo.vehicle.getLaneChangeMode("a"), sumo.vehicle.getSpeedMode("a")]
        rows = []
        for _ in CutInCommand("a", -1, 5.0).steps(sumo, STEP):
            sumo.simulationStep()
            rows.append((sumo.vehicle.getPosition("a")[1], sumo.vehicle.getSpeed("a"), sumo.vehicle.getSpeed("b")))
        y, speed, follower = np.array(rows).T
        assert sumo.vehicle.getLaneIndex("a") == 0
        assert y[-1] - y[0] == pytest.approx(-3.6, abs=0.1)
        assert np.abs(np.diff(y)).max() < 1.5 * STEP
        assert lateral_jerk(y) < 25.0
        assert np.abs(np.diff(speed, 2)).max() / STEP < 0.5
        assert follower.min() < follower[0] - 1.0
        assert before == [sumo.vehicle.getLaneChangeMode("a"), sumo.vehicle.getSpeedMode("a")]


def test_a_profile_has_the_jerk_and_the_peak_it_is_given() -> None:
    profile = ramp_hold_ramp(-6.0, 12.0, 1.0, 8.0, STEP)
    assert profile.min() == -6.0
    assert np.diff(profile).min() / STEP == pytest.approx(-12.0)
    assert np.diff(profile).max() / STEP == pytest.approx(8.0)


def test_the_stopping_distance_is_what_a_stop_takes(lone: Scenario) -> None:
    """With a stop much harder than the default: the settings reach the vehicle and the distance that is planned."""
    hard = StopInLaneCommandSettings(deceleration_mps2=5.0, jerk_mps3=10.0)
    for settings, peak in ((STOP, -2.5), (hard, -5.0)):
        seen = play(lone, StopInLaneCommand("a", 1.0, settings), after_s=0.0)
        stop = int(np.flatnonzero(seen["speed"] == 0.0)[0])
        driven_m = seen["x"][stop] - seen["x"][0]
        assert driven_m == pytest.approx(stopping_m(seen["speed"][0], settings), abs=2.0)
        assert condition(seen["speed"], STEP, 0.15, 1).min() == pytest.approx(peak, rel=0.08)


@pytest.mark.parametrize("deceleration", [0.5, 2.0])
def test_a_slow_vehicle_slows_as_its_settings_say(lone: Scenario, deceleration: float) -> None:
    settings = SlowVehicleCommandSettings(deceleration_mps2=deceleration, jerk_mps3=2.0)
    seen = play(lone, SlowVehicleCommand("a", 0.7, 0.0, settings), after_s=0.0)
    assert condition(seen["speed"], STEP, 0.15, 1).min() == pytest.approx(-deceleration, rel=0.1)
    assert seen["speed"].min() == pytest.approx(0.7 * seen["speed"][0], rel=0.05)
