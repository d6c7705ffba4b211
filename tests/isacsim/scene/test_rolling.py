"""A body's track is told that vehicles roll along their lanes, and which lane that is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scene.extent import LASTS
from isac_cosim.isacsim.scene.road import NEAR_M, RoadMap
from isac_cosim.isacsim.scene.rolling import ACROSS_JERK, ACROSS_MPS, ACROSS_SHARE, rolled, rolling_noise
from isac_cosim.isacsim.tracking.kalman import process_noise


def tracks(seed: int, count: int = 3) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, 7, 7))
    return rng.normal(size=(count, 7)) * 10, root @ root.transpose(0, 2, 1)


@given(st.floats(-np.pi, np.pi))
def test_the_jerk_is_less_across_the_heading_wherever_that_points(heading: float) -> None:
    noise = np.zeros((7, 7))
    noise[:6, :6], noise[6, 6] = process_noise(0.04, 10.0), 1.0
    found = rolling_noise(noise, np.array([[np.cos(heading), np.sin(heading)]]))[0]
    turn = np.eye(7)
    for k in (0, 2, 4):
        turn[k : k + 2, k : k + 2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    ahead, across = noise.copy(), np.zeros((7, 7))
    ahead[1:6:2] = ahead[:, 1:6:2] = 0.0
    across[:6, :6] = process_noise(0.04, 10.0 * ACROSS_JERK)
    across[0:6:2] = across[:, 0:6:2] = 0.0
    assert found == pytest.approx(turn @ (ahead + across) @ turn.T, abs=1e-12)


@given(st.integers(0, 1000), st.floats(-np.pi, np.pi))
def test_it_is_a_measurement_of_no_velocity_across_the_lane(seed: int, heading: float) -> None:
    state, covariance = tracks(seed)
    along = np.array([np.cos(heading), np.sin(heading)])
    found, certain = rolled(state, covariance, np.tile(along, (3, 1)))
    measures = np.zeros((1, 7))
    measures[0, 2:4] = -along[1], along[0]
    for of, spread, after, less in zip(state, covariance, found, certain, strict=True):
        noise = LASTS * (ACROSS_MPS + ACROSS_SHARE * np.hypot(of[2], of[3])) ** 2
        information = np.linalg.inv(spread) + measures.T @ measures / noise
        assert less == pytest.approx(np.linalg.inv(information), rel=1e-5, abs=1e-7)
        assert after == pytest.approx(np.linalg.solve(information, np.linalg.solve(spread, of)), rel=1e-5, abs=1e-6)


def test_who_stands_stops_drifting_and_a_lane_change_goes_on() -> None:
    state = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 4.6], [0.0, 0.0, 30.0, 1.0, 0.0, 0.0, 4.6]])
    covariance = np.tile(np.diag([0.1, 0.1, 0.04, 0.04, 0.1, 0.1, 0.1]), (2, 1, 1))
    for _ in range(25):
        state, _ = rolled(state, covariance, np.array([[1.0, 0.0], [1.0, 0.0]]))
    assert state[0, 3] < 0.05
    assert state[1, 3] > 0.95


def test_who_is_on_no_lane_is_told_nothing() -> None:
    state, covariance = tracks(1)
    found, certain = rolled(state, covariance, np.full((3, 2), np.nan))
    assert np.array_equal(found, state)
    assert np.array_equal(certain, covariance)


def lane(name: str, *shape: tuple[float, float]) -> Lane:
    return Lane(name, name, 0, 3.6, 100.0, np.array(shape), ())


def test_of_crossing_lanes_the_one_counts_that_leads_the_way() -> None:
    road = RoadMap([lane("east", (-50.0, 0.0), (50.0, 0.0)), lane("north", (0.0, -50.0), (0.0, 50.0))])
    place = np.array([[0.5, 0.5], [0.5, 0.5], [0.5, 0.5], [20.0, 2 * NEAR_M]])
    ahead = np.array([[0.9, np.sqrt(0.19)], [0.1, np.sqrt(0.99)], [-1.0, 0.0], [1.0, 0.0]])
    along = road.along(place, ahead)
    assert along[:2] == pytest.approx(np.eye(2))
    assert np.isnan(along[2:]).all()
    assert np.isnan(RoadMap([]).along(place, ahead)).all()


def test_the_road_is_left_where_no_lane_goes_on() -> None:
    """The middle lane of three ends where the outer ones go on; a crossing road is left at its own ends."""
    across = lane("across", (20.0, -60.0), (20.0, 60.0))
    beyond = lane("beyond", (110.0, -60.0), (110.0, 60.0))
    road = RoadMap([lane("one", (0.0, 0.0), (50.0, 0.0)), lane("two", (0.0, 3.2), (90.0, 3.2)), across, beyond])
    place = np.array([[50.5, 0.0], [89.5, 3.2], [90.5, 3.2], [91.0, 6.0], [20.0, 61.0], [20.0, -61.0], [109.0, 3.2]])
    assert road.left(place).tolist() == [False, False, True, True, True, False, False]
    assert not RoadMap([]).left(place).any()
