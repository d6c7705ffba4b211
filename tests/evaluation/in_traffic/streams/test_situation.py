"""What a window says of the situation, on drives whose motion is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.lane_motion import LaneMotion
from isac_cosim.models.data.situation import FEATURES, LONGEST_S, situation
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.hazards import blocks
from isac_cosim.models.hazards.sight import drive_and_situation
from isac_cosim.models.predictors.rule import RuleSettings

RATE_HZ, UV_RATE_HZ, WINDOW_S, WIDTH_M = 400.0, 100.0, 2.2, 3.6


@dataclass(frozen=True)
class Line:
    shape: np.ndarray
    id: str
    width_m: float = WIDTH_M


def states(rate_hz: float, along: np.ndarray, across: np.ndarray, angle: float) -> np.ndarray:
    """States (1, 6, T) of a vehicle on a straight road in some direction, from its way along and across it."""
    way = np.stack([along, across])
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    velocity = np.gradient(way, 1 / rate_hz, axis=1, edge_order=2)
    acceleration = np.gradient(velocity, 1 / rate_hz, axis=1, edge_order=2)
    return np.concatenate([rotation @ part for part in (way, velocity, acceleration)])[None]


def seen(
    acceleration: float = 0.0, aside: float = 0.0, start: float = 0.0, gap: float = 40.0, uv_speed: float = 20.0,
    uv_acceleration: float = 0.0, lanes: int = 2, angle: float = 0.0,
) -> dict[str, float]:  # fmt: skip
    """Features of a window of a TV at 20 m/s in the right lane of a straight road. gap, speeds: at the window's end."""
    t, t_uv = (np.arange(round(WINDOW_S * rate)) / rate for rate in (RATE_HZ, UV_RATE_HZ))
    back, back_uv = t - t[-1], t_uv - t_uv[-1]
    tv = states(RATE_HZ, 200 + 20 * back + acceleration / 2 * back**2, start + aside * t, angle)
    uv_way = 200 + gap + uv_speed * back_uv + uv_acceleration / 2 * back_uv**2
    uv = states(UV_RATE_HZ, uv_way, np.zeros(len(t_uv)), angle)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    lines = [
        Line(np.array([[0.0, k * WIDTH_M], [1000.0, k * WIDTH_M]]) @ rotation.T, f"road_{k}") for k in range(lanes)
    ]
    lane_map = LaneMap.of(lines)
    on_map = OnMap.in_one(tv, uv, RATE_HZ, lane_map)
    values = situation(on_map, LaneMotion.of(on_map, 0.5))
    assert values.shape == (1, len(FEATURES))
    return dict(zip(FEATURES, values[0].tolist(), strict=True))


def test_features_have_distinct_names() -> None:
    assert len(set(FEATURES)) == len(FEATURES)


@given(st.floats(-6.0, 4.0), st.floats(-np.pi, np.pi))
def test_accelerations_are_those_along_the_lane_whatever_its_direction(acceleration: float, angle: float) -> None:
    features = seen(acceleration=acceleration, angle=angle)
    for name in ("acceleration_0", "acceleration_0.7", "acceleration_1.5", "acceleration_least", "acceleration_most"):
        assert features[name] == pytest.approx(acceleration, abs=0.05)
    assert features["speed"] == pytest.approx(20.0 - 0.05 * acceleration, abs=0.05)
    assert features["speed_first"] == pytest.approx(20.0 - (WINDOW_S - 0.05) * acceleration, abs=0.05)


def test_what_is_kept_of_a_batch_is_not_taken_for_that_of_another() -> None:
    """Predictors that do not see the UV ask for the same windows with the TV in its place."""
    t = np.arange(round(WINDOW_S * UV_RATE_HZ)) / UV_RATE_HZ
    tv = states(RATE_HZ, 20 * np.arange(round(WINDOW_S * RATE_HZ)) / RATE_HZ, np.zeros(round(WINDOW_S * RATE_HZ)), 0.0)
    lanes = LaneMap.of([Line(np.array([[0.0, 0.0], [1000.0, 0.0]]), "road_0")])
    near, far = (states(UV_RATE_HZ, gap + 20 * t, np.zeros(len(t)), 0.0) for gap in (20.0, 60.0))
    windows = OnMap.in_one(tv, near, RATE_HZ, lanes)
    for on_map in (windows, replace(windows, uv=far), windows):
        drive, features = drive_and_situation(on_map)
        motion = LaneMotion.of(on_map, RuleSettings().smooth_s)
        np.testing.assert_array_equal(features[:, -len(FEATURES) :], situation(on_map, motion))
        assert drive_and_situation(on_map)[0] is drive


def test_the_way_aside_leads_to_the_marking() -> None:
    features = seen(aside=0.5, start=-0.6)
    offset = -0.6 + 0.5 * WINDOW_S
    assert features["offset"] == pytest.approx(offset, abs=0.01)
    assert features["aside_1"] == pytest.approx(0.5, abs=0.01)
    assert features["moved_1"] == pytest.approx(0.5, abs=0.01)
    assert features["moved"] == pytest.approx(0.5 * WINDOW_S, abs=0.01)
    assert features["left_crossing_s"] == pytest.approx((WIDTH_M / 2 - offset) / 0.5, abs=0.05)
    assert features["right_crossing_s"] == LONGEST_S


def test_lanes_beside_are_seen_where_they_are() -> None:
    features = seen(start=0.3)
    assert features["left_0"] == pytest.approx(0.0, abs=0.01)
    assert features["left_120"] == pytest.approx(0.0, abs=0.01)
    assert features["right_0"] == pytest.approx(WIDTH_M, abs=0.01)
    assert features["own_50"] == pytest.approx(0.0, abs=0.01)
    assert seen(lanes=1)["left_0"] == pytest.approx(WIDTH_M, abs=0.01)


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_the_lane_beside_a_vehicle_is_none_that_comes_towards_it(speed: float) -> None:
    """Neither where it drives nor where it stands, and the error of its velocity points backwards."""
    t, t_uv = (np.arange(round(WINDOW_S * rate)) / rate for rate in (RATE_HZ, UV_RATE_HZ))
    tv = states(RATE_HZ, 200 + speed * t, np.zeros(len(t)), 0.0)
    tv[:, 2] -= 0.01
    uv = states(UV_RATE_HZ, 240 + speed * t_uv, np.zeros(len(t_uv)), 0.0)
    ways = [[0.0, 0.0], [1000.0, 0.0]], [[1000.0, WIDTH_M], [0.0, WIDTH_M]]
    lanes = LaneMap.of([Line(np.array(way), f"road{k}_0") for k, way in enumerate(ways)])
    on_map = OnMap.in_one(tv, uv, RATE_HZ, lanes)
    of_trees = dict(zip(FEATURES, situation(on_map, LaneMotion.of(on_map, 0.5))[0].tolist(), strict=True))
    of_network = dict(zip(blocks.FEATURES, blocks.steps_of(on_map, (40, 10), True)[0, -1].tolist(), strict=True))
    for name, features in (("left_0", of_trees), ("left_lane", of_network)):
        assert features[name] == pytest.approx(WIDTH_M, abs=0.02)


def test_a_conflict_with_the_uv_is_the_deceleration_that_avoids_it() -> None:
    features = seen(gap=25.0, uv_speed=12.0, uv_acceleration=-4.0)
    speed, room = 20.0, 25.0 - 5.0
    uv_speed = 12.0 + 4.0 * 0.045  # averaged over the last 0.1 s
    assert features["gap"] == pytest.approx(25.0, abs=0.05)
    assert features["uv_acceleration_0"] == pytest.approx(-4.0, abs=0.05)
    assert features["closing"] == pytest.approx(speed - uv_speed, abs=0.05)
    assert features["closing_faster"] == pytest.approx(4.0, abs=0.05)
    assert features["ttc_s"] == pytest.approx(room / (speed - uv_speed), abs=0.05)
    assert features["needed"] == pytest.approx((speed - uv_speed) ** 2 / (2 * room), abs=0.05)
    stops_in = uv_speed**2 / 8
    assert features["needed_if_uv_stops"] == pytest.approx(speed**2 / (2 * (room + stops_in)), abs=0.05)


def test_a_faster_uv_is_never_reached() -> None:
    features = seen(uv_speed=25.0)
    assert features["ttc_s"] == LONGEST_S
    assert features["needed"] == 0.0
