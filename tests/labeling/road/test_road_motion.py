"""Motion relative to the road: the same for the same driving, whatever the road is like."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.road_motion import RoadMotion, road_motion, slope
from tests.support.drives import STEP_S, WIDTH_M, Drive, Road, Stretch, record, sweep, total

WIDTH_S = 0.15


def motion_of(recording: Recording, vehicle: str = "tv") -> RoadMotion:
    return road_motion(recording, recording.tracks[vehicle], LaneGraph(recording.lanes), WIDTH_S)


@pytest.mark.parametrize(("step_s", "every"), [(0.01, 5), (0.012, 4), (0.05, 1), (0.08, 1)])
def test_conditioning_is_that_of_the_motion_chain(step_s: float, every: int) -> None:
    """The decimating filter agrees with the one that conditions sensed motion."""
    rng = np.random.default_rng(1)
    speed = 30 + np.cumsum(rng.normal(0, 0.05, 1003))
    recording = record(Road(), Drive("tv", duration_s=1002 * step_s, speed=lambda t: speed), step_s=step_s)
    motion = motion_of(recording)
    assert np.allclose(motion.v, condition(speed, step_s, WIDTH_S)[::every], atol=1e-4)
    exact = condition(speed, step_s, WIDTH_S, order=1)[::every]
    assert np.allclose(motion.a[3:-3], exact[3:-3], atol=0.01)


def test_slope_of_a_sine() -> None:
    t = np.arange(0.0, 5.0, 0.05)
    assert np.allclose(slope(np.sin(2 * t), 0.05)[2:-2], 2 * np.cos(2 * t)[2:-2], atol=1e-4)


def test_motion_along_and_across_a_straight_road_in_closed_form() -> None:
    move = sweep(10.0, 5.0, WIDTH_M)
    recording = record(Road(), Drive("tv", speed=lambda t: 20 + 0.3 * t, lateral=move, duration_s=30))
    motion = motion_of(recording)
    inner = slice(20, -20)
    assert np.allclose(motion.a[inner], 0.3, atol=1e-6)
    assert np.allclose(motion.q[inner], move(motion.times)[inner], atol=0.01)
    during = (motion.times > 11) & (motion.times < 14)
    wave = 2 * np.pi * WIDTH_M / 25 * np.sin(2 * np.pi * (motion.times - 10) / 5)
    # The kernel passes a sine of angular frequency w at exp(-(w * width)^2 / 2).
    assert np.allclose(motion.aq[during], wave[during] * np.exp(-((2 * np.pi / 5 * WIDTH_S) ** 2) / 2), atol=0.02)


SPLITS = st.lists(st.sampled_from([0.3, 7.0, 60.0, 250.0]), min_size=1, max_size=4)


@given(
    lengths=SPLITS,
    junctions=st.booleans(),
    renumber=st.lists(st.integers(0, 1), min_size=5, max_size=5),
    curvature=st.integers(-5, 5).map(lambda k: k / 1000.0),
    heading=st.floats(-3.1, 3.1),
    origin=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    step=st.sampled_from([1, 5]),
)
@settings(max_examples=40, deadline=None)
def test_the_same_driving_looks_the_same_on_any_road(
    lengths: list[float],
    junctions: bool,
    renumber: list[int],
    curvature: float,
    heading: float,
    origin: tuple[float, float],
    step: int,
) -> None:
    """Curves, places on the map, edge splits, junction lanes, and lanes renumbered where one begins on the right."""
    stretches = []
    for k, length in enumerate([*lengths, 3000.0]):
        slots = tuple(range(-renumber[k], 3))
        stretches.append(Stretch(length, slots))
        if junctions:
            stretches.append(Stretch(5.0, (0, 1, 2), internal=True))
    road = Road(tuple(stretches), curvature, heading, origin)
    drive = Drive("tv", lateral=total(sweep(4.0, 5.0, WIDTH_M), sweep(14.0, 4.0, -WIDTH_M)), duration_s=25)
    plain, motion = motion_of(record(Road(), drive)), motion_of(record(road, drive, step_s=step * STEP_S))
    assert [(c.left, c.marking) for c in motion.crossings] == [(True, 0), (False, 0)]
    assert np.allclose([c.time for c in motion.crossings], [c.time for c in plain.crossings], atol=0.05)
    assert [c.at_m for c in motion.crossings] == pytest.approx([WIDTH_M / 2, WIDTH_M / 2])
    assert not motion.jumps
    for name in ("q", "vq", "aq"):
        values = np.interp(plain.times, motion.times, getattr(motion, name))
        assert np.allclose(values, getattr(plain, name), atol=0.05), name


def by_lanes(lanes: tuple[Lane, ...], visits: list[tuple[int, float]], lat: list[float]) -> RoadMotion:
    """A vehicle that spends a second on each lane, with one lateral offset on each."""
    lane = np.repeat([k for k, _ in visits], 100).astype(np.int32)
    pos = np.concatenate([start + np.arange(100) * 0.3 for _, start in visits])
    n = len(lane)
    x, y = np.arange(n) * 0.3, np.zeros(n)
    track = Track("tv", "passenger", 5.0, 1.8, 0, x, y, np.full(n, 30.0), lane, pos, np.repeat(lat, 100))
    return motion_of(Recording("scripted", 1, STEP_S, lanes, {"tv": track}))


SHAPE = np.zeros((2, 2))


def test_a_flip_in_the_very_step_of_an_edge_change_is_a_crossing() -> None:
    road = Road((Stretch(30.0), Stretch(5.0, internal=True), Stretch(100.0)))
    lanes = road.lanes()
    number = {lane.id: k for k, lane in enumerate(lanes)}
    motion = by_lanes(lanes, [(number["e0_0"], 0.0), (number["e2_1"], 0.0)], [1.59, -1.6])
    assert [(c.left, c.marking) for c in motion.crossings] == [(True, 0)]
    assert motion.q[-1] == pytest.approx(WIDTH_M - 1.6)


def test_a_flip_just_before_and_one_just_after_an_edge_change() -> None:
    """Only one of two lanes continues, or only one of two has a predecessor."""
    lanes = (
        Lane("a_0", "a", 0, WIDTH_M, 30.0, SHAPE, ("exit_0",)),
        Lane("a_1", "a", 1, WIDTH_M, 30.0, SHAPE, ("b_0",)),
        Lane("b_0", "b", 0, WIDTH_M, 30.0, SHAPE, ()),
        Lane("b_1", "b", 1, WIDTH_M, 30.0, SHAPE, ()),
        Lane("exit_0", "exit", 0, WIDTH_M, 30.0, SHAPE, ()),
    )
    before = by_lanes(lanes, [(0, 0.0), (2, 0.0)], [1.6, -1.6])
    after = by_lanes(lanes, [(1, 0.0), (3, 0.0)], [1.6, -1.6])
    for motion in (before, after):
        assert [(c.left, c.at_m) for c in motion.crossings] == [(True, WIDTH_M / 2)]
        assert np.allclose(motion.q, 1.6)


def test_centre_lines_that_do_not_meet_are_not_lateral_motion() -> None:
    road = Road((Stretch(30.0), Stretch(100.0)))
    motion = by_lanes(road.lanes(), [(0, 0.0), (3, 0.0)], [0.1, -0.9])
    assert not motion.crossings
    assert not motion.jumps
    assert np.allclose(motion.q, 0.1)


def test_a_step_within_a_lane_is_a_jump() -> None:
    motion = by_lanes(Road().lanes(), [(0, 0.0), (0, 30.0)], [0.0, 0.9])
    assert motion.jumps == pytest.approx((1.0,))


def test_a_merge_and_a_fork_are_not_crossings() -> None:
    """Two lanes continue in one, and one continues in two: the road moves sideways, not the vehicle."""
    lanes = (
        Lane("a_0", "a", 0, WIDTH_M, 30.0, SHAPE, ("b_0",)),
        Lane("a_1", "a", 1, WIDTH_M, 30.0, SHAPE, ("b_0",)),
        Lane("b_0", "b", 0, WIDTH_M, 30.0, SHAPE, ("c_0", "c_1")),
        Lane("c_0", "c", 0, WIDTH_M, 100.0, SHAPE, ()),
        Lane("c_1", "c", 1, WIDTH_M, 100.0, SHAPE, ()),
    )
    for first in (0, 1):
        for last in (3, 4):
            motion = by_lanes(lanes, [(first, 0.0), (2, 0.0), (last, 0.0)], [0.0, 0.0, 0.0])
            assert not motion.crossings
            assert np.allclose(motion.q, 0.0)


def test_lanes_of_unequal_width_are_as_far_apart_as_their_halves() -> None:
    lanes = tuple(Lane(f"a_{k}", "a", k, w, 500.0, SHAPE, ()) for k, w in enumerate((3.0, 3.5, 4.0)))
    graph = LaneGraph(lanes)
    assert graph.across(0, 1) == pytest.approx(3.25)
    assert graph.across(0, 2) == pytest.approx(1.5 + 3.5 + 2.0)
    assert graph.across(2, 0) == pytest.approx(-7.0)
