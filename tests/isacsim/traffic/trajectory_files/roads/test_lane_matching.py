"""Lanes of vehicles whose file names none: where roads overlap, the connected one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.roads.lane_matching import match_lanes


def lane(name: str, shape: list[list[float]], *successors: str, width_m: float = 3.0) -> Lane:
    points = np.array(shape)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Lane(name, name.rpartition("_")[0], int(name[-1]), width_m, length, points, successors)


# Two roads come from the west, 2 m apart, share 40 m of a junction, and leave as they came.
CROSSING = (
    lane("a_0", [[0.0, 1.0], [100.0, 1.0]], ":j_a_0"), lane(":j_a_0", [[100.0, 0.0], [140.0, 0.0]], "b_0"),
    lane("b_0", [[140.0, 1.0], [240.0, 1.0]]),
    lane("c_0", [[0.0, -1.0], [100.0, -1.0]], ":j_c_0"), lane(":j_c_0", [[100.0, 0.2], [140.0, 0.2]], "d_0"),
    lane("d_0", [[140.0, -1.0], [240.0, -1.0]]),
)  # fmt: skip


def matched(lanes: tuple[Lane, ...], x: np.ndarray, y: np.ndarray, heading: complex = 1.0) -> list[str]:
    numbers = match_lanes(
        LanePlaces(lanes), x + 1j * y, np.full(len(x), heading), np.zeros(len(x), np.int32)
    )  # fmt: skip
    return [lanes[k].id if k >= 0 else "" for k in numbers.tolist()]


@pytest.mark.parametrize(("side", "driven"), [(1.0, ["a_0", ":j_a_0", "b_0"]), (-1.0, ["c_0", ":j_c_0", "d_0"])])
@settings(deadline=None)
@given(st.floats(-0.2, 0.2))
def test_inside_a_junction_the_connected_lane_is_meant(side: float, driven: list[str], off: float) -> None:
    x = np.arange(1.0, 239.0, 2.0)
    y = np.where((x > 100.0) & (x < 140.0), 0.1, side) + off
    assert list(dict.fromkeys(matched(CROSSING, x, y))) == driven


@settings(deadline=None)
@given(st.lists(st.floats(-4.4, 7.4), min_size=2, max_size=20))
def test_beside_each_other_the_nearest_lane_is_meant(y: list[float]) -> None:
    lanes = tuple(lane(f"e_{k}", [[0.0, 3.0 * k], [100.0, 3.0 * k]]) for k in range(3))
    found = matched(lanes, np.linspace(1.0, 99.0, len(y)), np.array(y))
    for at, name in zip(y, found, strict=True):
        if not -2.4 < at < 8.4:
            continue
        assert name in {f"e_{k}" for k in range(3) if abs(at - 3.0 * k) <= min(abs(at - 3.0 * j) for j in range(3))}


def test_against_the_lane_or_beside_the_road_is_in_no_lane() -> None:
    lanes = (lane("e_0", [[0.0, 0.0], [100.0, 0.0]]),)
    x = np.linspace(1.0, 99.0, 9)
    assert set(matched(lanes, x, np.zeros(9), -1.0)) == {""}
    assert set(matched(lanes, x, np.full(9, 2.6))) == {""}
    assert set(matched(lanes, x, np.full(9, 2.4))) == {"e_0"}
    assert matched(lanes, np.array([50.0, -30.0, 60.0]), np.zeros(3)) == ["e_0", "", "e_0"]
