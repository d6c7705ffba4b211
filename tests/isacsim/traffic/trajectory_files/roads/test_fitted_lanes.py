"""Lanes fitted to where vehicles drive: side by side where they are, and ramps as roads of their own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.traffic.trajectory_files.roads.fitted_lanes import fitted_lanes


def driven(number: int, centre: np.ndarray, along: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Thirty vehicles in one lane: each has a habit of its own, of 0.2 m, and sways by 0.1 m."""
    habits = rng.normal(0.0, 0.2, (30, 1))
    left = centre + habits + rng.normal(0.0, 0.1, (30, len(along)))
    return np.tile(along, 30), left.ravel(), np.full(left.size, number)


def road(widths: list[float], bend_m: float, ramp: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    along = np.arange(2.0, 600.0, 3.0)
    course = bend_m * np.sin(along / 300.0)
    right = np.cumsum([0.0, *[(a + b) / 2.0 for a, b in pairwise(widths)]])
    parts = [driven(k + 1, course - off, along, rng) for k, off in enumerate(right)]
    if ramp:
        near = along[along < 250.0]
        parts.append(driven(7, bend_m * np.sin(near / 300.0) - right[-1] - 3.5 - (250.0 - near) / 8.0, near, rng))
    return (
        np.concatenate([p[0] for p in parts]),
        np.concatenate([p[1] for p in parts]),
        np.concatenate([p[2] for p in parts]),
    )


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(3.2, 4.0), min_size=2, max_size=6), st.floats(-8.0, 8.0), st.booleans())
def test_lanes_side_by_side_are_found_with_their_distances(widths: list[float], bend_m: float, ramp: bool) -> None:
    along, left, lane = road(widths, bend_m, ramp)
    fitted = fitted_lanes(along, left, lane)
    assert fitted.side_by_side == tuple(range(1, len(widths) + 1))
    main = [one for one in fitted.lanes if one.edge == "road"]
    assert [one.id for one in main] == [f"road_{k}" for k in range(len(widths), 0, -1)]
    assert [one.index for one in main] == list(range(len(widths)))
    for right, beside in pairwise(main):
        apart = beside.shape[:, 1] - right.shape[:, 1]
        # The widths meet at the marking, so that a change over it is no jump.
        assert np.abs(apart - (right.width_m + beside.width_m) / 2.0).max() < 1e-6
        number = int(right.id.rpartition("_")[2])
        assert abs(apart.mean() - (widths[number - 1] + widths[number - 2]) / 2.0) < 0.3
    assert [one.edge for one in fitted.lanes if one.edge != "road"] == (["lane7"] if ramp else [])
    agree = np.array([fitted.lanes[k].id.rpartition("_")[2] for k in fitted.number[lane < 7]]) == lane[lane < 7].astype(
        str
    )
    assert agree.mean() > 0.999
    if ramp:
        assert {fitted.lanes[k].edge for k in fitted.number[lane == 7]} == {"lane7"}


def test_a_course_does_not_wiggle_where_vehicles_have_habits() -> None:
    """A slope of 0.3 degrees is a lateral speed of 0.15 m/s at 30 m/s; a lane change begins with 0.2 m/s."""
    along, left, lane = road([3.6, 3.6, 3.6, 3.6], 0.0, ramp=True)
    fitted = fitted_lanes(along, left, lane)
    for one in fitted.lanes:
        if one.edge == "road":
            slopes = np.diff(one.shape[:, 1]) / np.diff(one.shape[:, 0])
            assert np.abs(slopes).max() < 0.003


def test_too_few_states_are_no_lane() -> None:
    along, left, lane = road([3.6, 3.6], 0.0, ramp=False)
    few = np.concatenate([np.flatnonzero(lane == 1), np.flatnonzero(lane == 2)[:20]])
    fitted = fitted_lanes(along[few], left[few], lane[few])
    assert [one.id for one in fitted.lanes] == ["road_1"]
    nowhere = fitted_lanes(along, left, np.zeros_like(lane))
    assert nowhere.lanes == ()
    assert set(nowhere.number.tolist()) == {-1}
