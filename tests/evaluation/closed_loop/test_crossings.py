"""Post-encroachment times of crossing paths against closed forms, and conflict points on bundled networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.crossings import conflict_points, crossings, joined
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

STEP_S = 0.01
HALF_M = 30.0
"""Both lanes are twice as long, and cross in the middle."""


def junction(angle: float, heading: float = 0.0) -> tuple[Lane, ...]:
    """Return two lanes that cross at an angle, and one that merges with the first."""
    ahead = np.exp(1j * np.array([heading, heading + angle]))
    ends = HALF_M * ahead[:, None] * np.array([-1.0, 0.3, 1.0])
    shapes = [*ends, np.array([ends[1, 0], ends[0, -1]])]
    return tuple(
        Lane(f":j_{k}_0", f":j_{k}", 0, 3.2, 2 * HALF_M, np.stack([shape.real, shape.imag], axis=1), ())
        for k, shape in enumerate(shapes)
    )


def drive(vehicle: str, lane: int, speed: float, start_s: float, length_m: float = 5.0) -> Track:
    """Return a drive along a lane at constant speed, and beyond its end."""
    along = speed * STEP_S * np.arange(round(2.5 * HALF_M / speed / STEP_S))
    still: Array = np.zeros(len(along))
    return Track(
        vehicle, "passenger", length_m, 1.8, round(start_s / STEP_S), still, still, still + speed,
        np.full(len(along), lane), along, still,
    )  # fmt: skip


@given(st.floats(0.4, 2.7), st.floats(0.0, 6.0), st.floats(5.0, 20.0), st.floats(5.0, 20.0), st.floats(0.0, 6.0))
def test_the_second_vehicle_arrives_after_the_first_has_left(
    angle: float, heading: float, first: float, second: float, wait_s: float
) -> None:
    wait_s = round(wait_s, 2)
    # The second lane is reached after the first one, whatever the speeds.
    start_s = round(max(0.0, HALF_M / first - HALF_M / second), 2) + wait_s + 0.01
    tracks = (drive("a", 0, first, 0.0), drive("b", 1, second, start_s))
    passage = crossings(Recording("junction", 0, STEP_S, junction(angle, heading), {t.vehicle: t for t in tracks}))
    pet_s = start_s + HALF_M / second - (HALF_M + 5.0) / first
    if pet_s > 5.0:
        assert len(passage.pet_s) == 0
        return
    assert (passage.entering, passage.behind, passage.crossing.tolist()) == (("a",), ("b",), [True])
    assert passage.pet_s[0] == pytest.approx(pet_s, abs=1e-6)
    assert passage.time_s[0] == pytest.approx(HALF_M / first, abs=1e-6)


def test_only_neighbours_in_time_on_different_lanes_count() -> None:
    tracks = (drive("a", 0, 10.0, 0.0), drive("b", 0, 10.0, 2.0), drive("c", 1, 10.0, 4.0), drive("d", 1, 10.0, 6.0))
    passage = crossings(Recording("junction", 0, STEP_S, junction(1.5), {t.vehicle: t for t in tracks}))
    assert (passage.entering, passage.behind) == (("b",), ("c",))
    assert passage.pet_s[0] == pytest.approx(2.0 - 0.5)
    both = joined(passage, passage)
    assert both.entering == ("b", "b")
    assert both.crossing.tolist() == [True, True]


def test_paths_that_merge_do_not_cross() -> None:
    lanes = junction(1.5)
    assert [point.lanes for point in conflict_points(lanes)] == [(0, 1)]
    tracks = (drive("a", 0, 10.0, 0.0), drive("b", 2, 10.0, 1.0))
    passage = crossings(Recording("junction", 0, STEP_S, lanes, {t.vehicle: t for t in tracks}))
    assert len(passage.pet_s) == len(joined(passage).pet_s) == 0


@pytest.mark.parametrize(
    ("ways_in", "ways_out", "crosses"), [((0, 1), (0, 1), True), ((0, 0), (0, 1), False), ((0, 1), (0, 0), False)]
)
def test_paths_from_one_edge_or_into_one_lane_do_not_cross(
    ways_in: tuple[int, int], ways_out: tuple[int, int], crosses: bool
) -> None:
    """Through a second lane inside the junction, as where vehicles wait in its middle."""
    first, second, _ = junction(1.5)
    away = np.array([[500.0, 0.0], [600.0, 0.0]])
    inside = [replace(lane, successors=(f":j_{k + 7}_0",)) for k, lane in enumerate((first, second))]
    waiting = [Lane(f":j_{k + 7}_0", f":j_{k + 7}", 0, 3.2, 100.0, away, (f"out{ways_out[k]}_0",)) for k in range(2)]
    before = [
        Lane(f"in{n}_0", f"in{n}", 0, 3.2, 100.0, away, tuple(f":j_{k}_0" for k in range(2) if ways_in[k] == n))
        for n in range(2)
    ]
    after = [Lane(f"out{n}_0", f"out{n}", 0, 3.2, 100.0, away, ()) for n in range(2)]
    points = conflict_points((*inside, *waiting, *before, *after))
    assert [point.lanes for point in points] == ([(0, 1)] if crosses else [])


@pytest.mark.parametrize(("name", "crosses"), [("urban", True), ("city", True), ("motorway", False)])
def test_conflict_points_lie_on_both_lanes(name: str, crosses: bool) -> None:
    lanes = load(name).lanes
    points = conflict_points(lanes)
    assert bool(points) == crosses
    for point in points:
        places = [position(lanes[lane], place) for lane, place in zip(point.lanes, point.places, strict=True)]
        np.testing.assert_allclose(places[0], places[1], atol=1e-6)


def position(lane: Lane, place_m: float) -> list[float]:
    """Return the point of a centre line at a place along the lane, m."""
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(lane.shape, axis=0).T))])
    return [float(np.interp(place_m / lane.length_m * ends[-1], ends, lane.shape[:, k])) for k in (0, 1)]
