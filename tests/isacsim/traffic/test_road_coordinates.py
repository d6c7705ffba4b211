"""Vehicles on polygons: the corners of a road leave no trace in their motion, and their positions hardly change."""

import gc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array, ComplexArray
from isac_cosim.isacsim.scenarios import reference_line
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.motion import MotionSettings, condition, excess, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.road_coordinates import RoundedTrack, moved_rows, smooth_step
from tests.support.drives import sweep

STEP = 0.01
AS_IT_IS = MotionSettings(max_shift_m=0.0)
CORNERS = st.lists(st.floats(-7.0, 7.0), min_size=1, max_size=8)


def polygon(turns_deg: list[float], side_m: float = 150.07, heading: float = 0.3) -> ComplexArray:
    """Return the vertices of a road that turns by these angles, one after every `side_m`."""
    headings = heading + np.radians(np.concatenate([[0.0], np.cumsum(turns_deg)]))
    return np.concatenate([[0.0], np.cumsum(side_m * np.exp(1j * headings))])


def drive(
    vertices: ComplexArray, speed: float, offset: Array | float = 0.0, length: float = 1.0
) -> tuple[Recording, Track]:
    """Return a drive along a polygon as SUMO records it. length: of the lane, relative to that of its shape."""
    sides = np.diff(vertices)
    ends = np.concatenate([[0.0], np.cumsum(np.abs(sides))])
    n = int((ends[-1] - 1.0) * length / speed / STEP)
    position = speed * STEP * np.arange(n)
    station = position / length
    k = np.clip(np.searchsorted(ends, station, side="right") - 1, 0, len(sides) - 1)
    along = sides[k] / np.abs(sides[k])
    lateral = np.broadcast_to(np.asarray(offset, float), (n,)) if np.ndim(offset) == 0 else np.asarray(offset)[:n]
    place = vertices[k] + along * (station - ends[k]) + 1j * along * lateral
    shape = np.stack([vertices.real, vertices.imag], axis=1)
    lane = Lane("road_0", "road", 0, 3.2, float(ends[-1] * length), shape, ())
    track = Track(
        "tv",
        "passenger",
        4.5,
        1.8,
        0,
        place.real.copy(),
        place.imag.copy(),
        np.full(n, speed),
        np.zeros(n, np.int32),
        position,
        np.array(lateral),
    )
    return Recording("kinked", 1, STEP, (lane,), {"tv": track}), track


def across(state: Array) -> Array:
    return np.asarray((state[2] * state[5] - state[3] * state[4]) / np.hypot(state[2], state[3]))


def inner(recording: Recording, track: Track, rate_hz: float = 100.0) -> Array:
    times = recording.times(track)
    return np.arange(times[0] + 1.2, times[-1] - 1.2, 1.0 / rate_hz)


@pytest.mark.parametrize(("turn_deg", "bound"), [(2.0, 3.7), (5.0, 3.7), (8.0, 4.5)])
def test_a_corner_at_motorway_speed_leaves_no_acceleration_that_a_driver_would_not_use(
    turn_deg: float, bound: float
) -> None:
    recording, track = drive(polygon([turn_deg, -turn_deg, turn_deg]), 30.0)
    times = inner(recording, track, 400.0)
    raw = np.abs(across(states(recording, track, times, AS_IT_IS))).max()
    # The corner as a Gaussian of 0.15 s in time: v w / (sqrt(2 pi) 0.15 s).
    assert raw == pytest.approx(30.0 * np.radians(turn_deg) / (np.sqrt(2 * np.pi) * 0.15), rel=0.02)
    rounded = states(recording, track, times, MotionSettings())
    assert np.abs(across(rounded)).max() < bound
    assert np.hypot(*np.diff(rounded[4:6], axis=1)).max() * 400.0 < 25.0
    assert len(excess(recording, track, MotionSettings()).beyond_car) == 0


def test_a_rounded_corner_moves_as_far_as_theory_says() -> None:
    """The tip of an isolated corner moves by v^2 w^2 / (2 pi A)."""
    vertices, turn, limit = polygon([5.0], side_m=300.0), np.radians(5.0), 3.0
    recording, track = drive(vertices, 30.0)
    state = states(recording, track, inner(recording, track), MotionSettings(lateral_mps2=limit))
    nearest = np.abs(state[0] + 1j * state[1] - vertices[1]).min()
    assert nearest == pytest.approx(30.0**2 * turn**2 / (2 * np.pi * limit), rel=0.25)


def test_a_straight_road_changes_nothing_not_even_by_rounding() -> None:
    offset = sweep(4.0, 4.0, 1.4)(np.arange(3000) * STEP)
    recording, track = drive(polygon([0.0, 0.0]), 30.0, offset)
    times = inner(recording, track)
    assert np.array_equal(states(recording, track, times, MotionSettings()), states(recording, track, times, AS_IT_IS))


def test_a_swerve_on_a_kinked_road_is_the_swerve_of_a_straight_one() -> None:
    offset = sweep(6.0, 2.0, 1.5)(np.arange(3000) * STEP)
    peaks = []
    for turns in ([0.0, 0.0, 0.0], [3.0, -3.0, 3.0]):
        recording, track = drive(polygon(turns), 30.0, offset)
        times = np.arange(6.0, 8.0, STEP)
        peaks.append(np.abs(across(states(recording, track, times, MotionSettings()))).max())
    assert peaks[0] > 1.8
    assert peaks[1] == pytest.approx(peaks[0], abs=0.1)


def test_a_corner_that_no_rounding_makes_drivable_is_beyond_a_car() -> None:
    recording, track = drive(polygon([35.0]), 30.0)
    times = excess(recording, track, MotionSettings()).beyond_car
    assert len(times)
    assert np.abs(times - 150.0 / 30.0).max() < 1.5


@settings(max_examples=25, deadline=None)
@given(turns=CORNERS, speed=st.floats(8.0, 38.0), offset=st.floats(-1.2, 1.2))
def test_positions_stay_within_the_stated_bound(turns: list[float], speed: float, offset: float) -> None:
    """Within max_shift_m of the raw track, and 0.15 m more for the smoothing in time and the turned offset."""
    recording, track = drive(polygon(turns), speed, offset)
    times, rows = inner(recording, track), np.rint(inner(recording, track) / STEP).astype(int)
    for bound in (0.3, 1.0):
        state = states(recording, track, times, MotionSettings(max_shift_m=bound))
        raw = np.array([condition(v, STEP, 0.15, 0, rows.astype(float)) for v in (track.x, track.y)])
        assert np.hypot(*(state[:2] - raw)).max() < bound + 0.15


@settings(max_examples=20, deadline=None)
@given(turns=CORNERS, angle=st.floats(0, 2 * np.pi), dx=st.floats(-1e4, 1e4), dy=st.floats(-1e4, 1e4))
def test_states_turn_and_move_with_the_road(turns: list[float], angle: float, dx: float, dy: float) -> None:
    vertices, offset = polygon(turns), sweep(3.0, 4.0, 1.0)(np.arange(20_000) * STEP)
    turned = vertices * np.exp(1j * angle) + dx + 1j * dy
    here, there = drive(vertices, 28.0, offset), drive(turned, 28.0, offset)
    times = inner(*here)
    first, second = (states(recording, track, times, MotionSettings()) for recording, track in (here, there))
    for k, shift in ((0, dx + 1j * dy), (2, 0.0), (4, 0.0)):
        expected = (first[k] + 1j * first[k + 1]) * np.exp(1j * angle) + shift
        np.testing.assert_allclose(second[k] + 1j * second[k + 1], expected, atol=1e-3)


@settings(max_examples=15, deadline=None)
@given(turns=CORNERS, cut=st.integers(2, 400))
def test_states_over_a_part_equal_those_of_the_whole(turns: list[float], cut: int) -> None:
    recording, track = drive(polygon(turns), 30.0, 0.4)
    times = inner(recording, track)
    whole = states(recording, track, times, MotionSettings())
    parts = [
        # A track made anew is not among those that are remembered.
        states(recording, replace(track), part, MotionSettings())
        for part in (times[:cut], times[cut:])
        if len(part)
    ]
    assert np.array_equal(np.concatenate(parts, axis=1), whole)


@settings(max_examples=15, deadline=None)
@given(turns=CORNERS, speed=st.floats(8.0, 36.0))
def test_velocity_is_the_derivative_of_position_and_acceleration_that_of_velocity(
    turns: list[float], speed: float
) -> None:
    recording, track = drive(polygon(turns), speed, 0.5)
    state = states(recording, track, inner(recording, track, 400.0), MotionSettings())
    for row in range(4):
        slope = (state[row, 2:] - state[row, :-2]) * 200.0
        np.testing.assert_allclose(state[row + 2, 1:-1], slope, atol=2e-2)


def test_speed_does_not_step_where_a_lane_is_longer_than_its_shape() -> None:
    """The same road in two lanes; SUMO gives the second one a length that is 4 % too large."""
    (first, track), (second, beyond) = (
        drive(polygon([0.0], 150.0), 30.0),
        drive(polygon([0.0], 150.0), 30.0, length=1.04),
    )
    ahead = 300.0 * np.exp(0.3j)
    shape = second.lanes[0].shape + np.array([ahead.real, ahead.imag])
    lanes = (first.lanes[0], replace(second.lanes[0], id="next_0", edge="next", shape=shape))
    wait = round(300.0 / 0.3) - len(track)  # rows until the vehicle reaches the second lane
    rest = first.lanes[0].length_m - track.lane_pos[-1] - 0.3 * np.arange(1, wait + 1)
    place = ahead - rest * np.exp(0.3j)
    joined = Track(
        "tv", "passenger", 4.5, 1.8, 0,
        np.concatenate([track.x, place.real, beyond.x + ahead.real]),
        np.concatenate([track.y, place.imag, beyond.y + ahead.imag]),
        np.full(len(track) + wait + len(beyond), 30.0),
        np.repeat([0, 1], [len(track) + wait, len(beyond)]).astype(np.int32),
        np.concatenate([track.lane_pos, 300.0 - rest, beyond.lane_pos]),
        np.zeros(len(track) + wait + len(beyond)),
    )  # fmt: skip
    recording = Recording("stretched", 1, STEP, lanes, {"tv": joined})
    times = inner(recording, joined)
    peaks = [np.hypot(*states(recording, joined, times, road)[4:6]).max() for road in (AS_IT_IS, MotionSettings())]
    # A step from 30 to 28.8 m/s within the kernel: 1.2 / (sqrt(2 pi) 0.15 s).
    assert peaks[0] == pytest.approx(30.0 * (1 - 1 / 1.04) / (np.sqrt(2 * np.pi) * 0.15), rel=0.1)
    assert peaks[1] < 0.8


@settings(max_examples=20, deadline=None)
@given(turns=CORNERS, speed=st.floats(8.0, 38.0), stretch=st.floats(0.97, 1.03))
def test_the_quick_look_at_a_line_never_changes_the_result(turns: list[float], speed: float, stretch: float) -> None:
    """Roads that clearly need no rounding are told from the others by a cheap estimate, and by a closer look."""
    recording, track = drive(polygon(turns), speed, 0.3, stretch)
    quick = moved_rows(recording, track, MotionSettings())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference_line, "is_gentle", lambda values, *_: np.zeros(len(values), bool))
        patch.setattr(reference_line, "_may_be_sharp", lambda *arguments: np.ones(len(arguments[-1]), bool))
        patch.setattr(reference_line, "NARROW", len(reference_line.WIDTHS_M))
        full = moved_rows(recording, track, MotionSettings())
    positions = [RoundedTrack.of(track, moved) for moved in (quick, full)]
    assert np.hypot(positions[0].x - positions[1].x, positions[0].y - positions[1].y).max() < 1e-6


@pytest.mark.parametrize("radius_m", [1200.0, 300.0])
def test_the_quick_looks_spare_gentle_bends(radius_m: float) -> None:
    """The first one spares a bend that takes 0.2 of the limit, the closer one a bend that takes 0.86."""
    vertices = radius_m * np.exp(1j * np.radians(np.arange(0.0, 60.0, 240.0 / radius_m)))
    recording, track = drive(vertices, 30.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference_line, "rounding_widths", None)
        assert len(moved_rows(recording, track, MotionSettings()).rows) == 0


@settings(max_examples=15, deadline=None)
@given(turns=st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=3), speed=st.floats(10.0, 38.0))
def test_limits_are_exceeded_at_the_times_at_which_the_states_exceed_them(turns: list[float], speed: float) -> None:
    """A coarse look first: it must not overlook a time."""
    recording, track = drive(polygon(turns), speed, 0.3)
    times = recording.times(track)
    _, _, vx, vy, ax, ay = states(recording, track, times, MotionSettings())
    beyond = np.hypot(ax, ay) > 9.0
    beyond[1:] |= np.hypot(np.diff(ax), np.diff(ay)) > 25.0 * STEP
    across_travel = np.abs(vx * ay - vy * ax) / np.hypot(vx, vy) > 4.0
    exceeded = excess(recording, track, MotionSettings(), across_mps2=4.0)
    # Values within rounding errors of a limit may fall on either side.
    assert abs(len(exceeded.beyond_car) - beyond.sum()) <= 1
    assert abs(len(exceeded.across) - across_travel.sum()) <= 1
    assert set(np.rint(exceeded.across / STEP)) <= set(np.rint(times / STEP))


def test_what_moves_is_forgotten_with_the_track() -> None:
    recording, track = drive(polygon([3.0]), 30.0)
    states(recording, track, inner(recording, track), MotionSettings())
    kept = {key for key in motion._MOVED if key[0] == id(track)}
    assert len(kept) == 1
    del recording, track
    gc.collect()
    assert not kept & motion._MOVED.keys()


def test_a_smooth_step_has_the_velocity_of_least_jerk() -> None:
    """The least integral of squared jerk has a velocity of 30 u^2 (1 - u)^2, here integrated numerically."""
    share = np.linspace(0.0, 1.0, 2001)
    velocity = 30.0 * share**2 * (1.0 - share) ** 2
    integral = np.concatenate([[0.0], np.cumsum((velocity[1:] + velocity[:-1]) / 2.0 * np.diff(share))])
    np.testing.assert_allclose(smooth_step(share), integral, atol=1e-6)
