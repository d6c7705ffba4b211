"""Places in lanes, from positions and velocities."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.models.data.lane_map import LaneMap


@dataclass(frozen=True)
class Line:
    shape: np.ndarray
    width_m: float
    id: str = "road_0"


def arc(radius: float, degrees: float, every: float = 3.0) -> np.ndarray:
    """A bend to the left that starts at the origin and heads along x."""
    angle = np.radians(np.arange(0, degrees + every, every))
    return np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1)


def test_of_two_lanes_side_by_side_the_nearer_one_is_the_vehicle_s() -> None:
    lanes = LaneMap.of([Line(np.array([[0, y], [500, y]]), 3.0 + y) for y in (0.0, 3.5)])
    places = lanes.place(np.array([[123.4, 1.5], [123.4, 2.0]]), np.array([[20.0, 0.5], [20.0, 0.5]]))
    np.testing.assert_allclose(places.offset_m, [1.5, -1.5], atol=1e-9)
    np.testing.assert_allclose(places.width_m, [3.0, 6.5])
    np.testing.assert_allclose(places.heading, [[1, 0], [1, 0]], atol=1e-9)


def test_a_lane_of_the_other_direction_or_across_is_none_of_its() -> None:
    forward, oncoming = np.array([[0.0, 0], [100, 0]]), np.array([[100.0, 3.2], [0, 3.2]])
    crossing = np.array([[50.0, -40], [50, 40]])
    lanes = LaneMap.of([Line(line, 3.2) for line in (forward, oncoming, crossing)])
    places = lanes.place(np.array([[50.0, 2.5], [50.0, 2.5]]), np.array([[9.0, 0.0], [-9.0, 0.0]]))
    np.testing.assert_allclose(places.offset_m, [2.5, 0.7], atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.02))
def test_a_vehicle_that_stands_is_in_its_lane_wherever_its_velocity_seems_to_point(way: float, speed: float) -> None:
    """With an oncoming lane beside it, and a crossing one near."""
    shapes = [[0.0, 0], [100, 0]], [[100.0, 3.2], [0, 3.2]], [[54.0, -40], [54, 40]]
    lanes = LaneMap.of([Line(np.array(shape), 3.2) for shape in shapes])
    in_lane = lanes.place(np.array([[50.0, 0.4]]), speed * np.array([[np.cos(way), np.sin(way)]]))
    assert in_lane.offset_m[0] == pytest.approx(0.4)
    np.testing.assert_allclose(in_lane.heading, [[1, 0]])


def test_on_a_junction_a_vehicle_that_goes_straight_on_is_not_in_the_lane_that_turns_off_over_its_own() -> None:
    turns_off = arc(12.0, 90) + np.array([50.0, 0.0])
    lanes = LaneMap.of([Line(np.array([[0.0, 0], [100, 0]]), 3.2), Line(turns_off, 3.2)])
    # 6 m into the junction, the lane that turns off is 1.6 m aside, and 30 degrees off.
    in_lane = lanes.place(np.array([[56.0, 1.2]] * 2), np.array([[12.0, 0.3], [10.4, 6.0]]))
    np.testing.assert_allclose(in_lane.heading[0], [1, 0], atol=1e-9)
    assert in_lane.offset_m[0] == pytest.approx(1.2)
    assert in_lane.heading[1, 1] == pytest.approx(0.5, abs=0.05)


@settings(max_examples=40, deadline=None)
@given(st.floats(60, 400), st.floats(5, 85), st.floats(-1.6, 1.6), st.floats(-3, 3))
def test_in_a_bend_the_offset_is_the_difference_of_radii(
    radius: float, degrees: float, offset: float, turned: float
) -> None:
    rotation = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    lanes = LaneMap.of([Line(arc(radius, 90) @ rotation.T + (700, -300), 3.2)])
    at = np.radians(degrees)
    place = np.array([0, radius]) + (radius - offset) * np.array([np.sin(at), -np.cos(at)])
    heading = np.array([np.cos(at), np.sin(at)])
    in_lane = lanes.place((rotation @ place)[None] + (700, -300), 15 * (rotation @ heading)[None])
    # The polyline with a vertex every 3 degrees lies inside the arc by up to radius (1 - cos 1.5 degrees).
    assert in_lane.offset_m[0] == pytest.approx(offset, abs=radius * 3.5e-4 + 0.02)
    np.testing.assert_allclose(in_lane.heading[0], rotation @ heading, atol=0.005)


def test_on_a_coarsely_drawn_road_a_vehicle_that_keeps_its_lane_does_not_seem_to_move_aside() -> None:
    """It drives along segments of 80 m, and rounds the corners between them as recordings do, with a Gaussian."""
    turns = np.radians([0.0, 4.0, 8.0, 5.0, 1.0, -2.0])
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(80 * np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=0)])
    along = np.arange(0, 480, 0.5)
    driven = np.stack([np.interp(along, 80 * np.arange(7), line[:, k]) for k in (0, 1)], axis=1)
    driven = gaussian_filter1d(driven, 5.0 / 0.5, axis=0, mode="nearest")
    velocity = 25 * np.gradient(driven, 0.5, axis=0)
    inner = slice(60, -60)
    in_lane = LaneMap.of([Line(line, 3.2)]).place(driven[inner], velocity[inner])
    aside = in_lane.heading[:, 0] * velocity[inner, 1] - in_lane.heading[:, 1] * velocity[inner, 0]
    assert np.abs(aside).max() < 0.25
    # The heading of a bend through the same vertices would be up to 2 degrees off.
    evenly = LaneMap.of([Line(line, 3.2)], corner_m=np.inf).place(driven[inner], velocity[inner])
    assert np.abs(evenly.heading[:, 0] * velocity[inner, 1] - evenly.heading[:, 1] * velocity[inner, 0]).max() > 0.5


@pytest.mark.parametrize("name", ["motorway", "ramp_weave"])
def test_the_roads_on_which_predictors_are_trained_are_drawn_finely(name: str) -> None:
    """How corners of coarsely drawn roads are rounded then changes nothing there."""
    lanes = load(name).lanes
    rounded, evenly = LaneMap.of(lanes), LaneMap.of(lanes, corner_m=np.inf)
    np.testing.assert_array_equal(rounded.heading, evenly.heading)
    np.testing.assert_array_equal(rounded.bend, evenly.bend)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_the_numbers_of_the_lanes_say_on_which_side_traffic_keeps(mirror: float) -> None:
    """Lane 0 is the outermost. An edge of one lane does not say."""
    lines = [Line(np.array([[0.0, 3.2 * k * mirror], [200.0, 3.2 * k * mirror]]), 3.2, f"a_b_{k}") for k in range(3)]
    lines.append(Line(np.array([[0.0, 20.0], [0.0, 90.0]]), 3.2, "single_0"))
    assert LaneMap.of(lines).lefthand == (mirror < 0)
    assert not LaneMap.of(lines[-1:]).lefthand


def test_lanes_without_length_are_passed_over() -> None:
    lanes = LaneMap.of([Line(np.zeros((2, 2)), 3.0), Line(np.array([[0.0, 1], [9, 1], [9, 1]]), 4.0)])
    assert lanes.place(np.zeros((1, 2)), np.array([[1.0, 0]])).width_m[0] == 4.0
