"""The vehicle ahead as a hazard: where it is, how it moves, and what it is a cause of, from what TraCI says."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.drivers.handling.hazards import VehicleAhead


def road(ahead: dict[str, object] | None, driving_m: float = 0.0) -> SimpleNamespace:
    """SUMO with the driver `own` 100 m into edge a, and the vehicle ahead, if there is one."""
    states: dict[str, dict[str, object]] = {
        "own": {
            "LaneID": "a_0",
            "RoadID": "a",
            "LanePosition": 100.0,
            "Speed": 30.0,
            "Acceleration": 0.0,
            "Length": 4.5,
        }
    }
    if ahead is not None:
        states["ahead"] = {**states["own"], "LanePosition": 150.0, **ahead}
    getters = {f"get{key}": lambda name, key=key: states[name][key] for key in states["own"]}
    vehicle = SimpleNamespace(
        getIDList=lambda: tuple(states), getDrivingDistance=lambda own, edge, place: driving_m, **getters
    )
    return SimpleNamespace(vehicle=vehicle)


AHEAD, CUT_IN = VehicleAhead("ahead"), VehicleAhead("ahead", cut_in=True)


def test_a_vehicle_that_has_gone_is_no_hazard() -> None:
    sumo = road(None)
    assert not AHEAD.shows(sumo, "own")
    assert AHEAD.gap_m(sumo, "own") == np.inf
    assert AHEAD.motion(sumo) == (np.inf, 0.0)


@pytest.mark.parametrize(("acceleration", "shows"), [(-0.9, False), (-1.1, True)])
def test_a_leader_shows_once_it_brakes(acceleration: float, shows: bool) -> None:
    assert AHEAD.shows(road({"Acceleration": acceleration}), "own") is shows


@pytest.mark.parametrize(("lane", "shows"), [("a_1", False), ("a_0", True)])
def test_a_cut_in_shows_once_it_is_in_the_lane(lane: str, shows: bool) -> None:
    assert CUT_IN.shows(road({"LaneID": lane}), "own") is shows


def test_the_gap_is_from_bumper_to_bumper_also_across_edges() -> None:
    assert AHEAD.gap_m(road({"Length": 12.0}), "own") == 38.0
    assert AHEAD.gap_m(road({"RoadID": "b", "LanePosition": 3.0}, driving_m=60.0), "own") == 55.5
    assert AHEAD.gap_m(road({"RoadID": "b", "LanePosition": 3.0}, driving_m=-1e9), "own") == np.inf


def test_what_it_is_a_cause_of() -> None:
    assert AHEAD.cause(road({"Speed": 1.0})) == CUT_IN.cause(road({"Speed": 1.0})) == "stopped_leader"
    assert CUT_IN.cause(road({"Acceleration": -3.0})) == "cut_in"
    assert AHEAD.cause(road({"Acceleration": -3.0})) == "braking_leader"
    assert AHEAD.cause(road({})) == "slow_leader"
