"""Conditioning: against closed forms, and consistent between position, velocity and acceleration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from isac_cosim.isacsim.traffic.motion import MotionSettings, condition, condition_at, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

STEP = 0.01


def recording_of(x: np.ndarray, y: np.ndarray, first_step: int = 0) -> tuple[Recording, Track]:
    n = len(x)
    track = Track(
        "v",
        "passenger",
        4.5,
        1.8,
        first_step,
        x,
        y,
        np.zeros(n),
        np.zeros(n, np.int32),
        np.zeros(n),
        np.zeros(n),
    )
    return Recording("road", 1, STEP, (), {"v": track}), track


@pytest.mark.parametrize("order", [0, 1, 2])
def test_condition_follows_the_closed_form_of_a_filtered_sine(order: int) -> None:
    t = np.arange(0.0, 20.0, STEP)
    omega, width = 2.0 * np.pi * 0.5, 0.15
    rows = np.linspace(500.0, 1500.0, 701)
    conditioned = condition(np.sin(omega * t), STEP, width, order, rows)
    gain = np.exp(-0.5 * (omega * width) ** 2) * omega**order
    expected = gain * np.sin(omega * rows * STEP + order * np.pi / 2.0)
    np.testing.assert_allclose(conditioned, expected, atol=1e-6 * omega**order)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_fractional_evaluation_agrees_with_the_grid(order: int) -> None:
    values = np.cumsum(np.random.default_rng(1).normal(size=600))
    on_grid = condition(values, STEP, 0.15, order)
    at_rows = condition(values, STEP, 0.15, order, np.arange(600.0))
    np.testing.assert_allclose(at_rows, on_grid, atol=1e-9 * np.abs(on_grid).max())


def test_several_orders_at_once_are_those_of_the_whole_signal_filtered_by_scipy() -> None:
    values = 100.0 + np.cumsum(np.random.default_rng(2).normal(size=600))
    sigma, inner = 0.15 / STEP, np.arange(200.0, 400.0)
    together = condition_at(values, STEP, 0.15, (2, 0, 1), inner)
    for row, order in zip(together, (2, 0, 1), strict=True):
        expected = gaussian_filter1d(values, sigma, order=order, truncate=8.0)[200:400] / STEP**order
        np.testing.assert_allclose(row, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("stride", [0.25, 1.0, 2.0, 2.5])
def test_evenly_spaced_instants_give_to_the_last_bit_what_they_give_in_any_order(stride: float) -> None:
    """Only evenly spaced ones share their windows of the signal without a copy."""
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.normal(0.3, 0.02, size=900))
    rows = 100.2 + stride * np.arange(250)
    shuffled = rng.permutation(len(rows))
    evenly = condition_at(values, STEP, 0.15, (0, 1, 2), rows)
    np.testing.assert_array_equal(condition_at(values, STEP, 0.15, (0, 1, 2), rows[shuffled]), evenly[:, shuffled])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), angle=st.floats(0, 2 * np.pi), dx=st.floats(-1e4, 1e4), first=st.integers(0, 10_000))
def test_states_turn_and_move_with_the_road(seed: int, angle: float, dx: float, first: int) -> None:
    xy = np.cumsum(np.random.default_rng(seed).normal(0.3, 0.02, size=(2, 500)), axis=1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    times = first * STEP + np.arange(1.0, 4.0, 0.0025)
    here = states(*recording_of(*xy, first), times, MotionSettings())
    there = states(*recording_of(*(turn @ xy + dx), first), times, MotionSettings())
    expected = np.concatenate([turn @ here[0:2] + dx, turn @ here[2:4], turn @ here[4:6]])
    np.testing.assert_allclose(there, expected, atol=1e-6)


def test_velocity_is_the_derivative_of_position_at_400_hz() -> None:
    rng = np.random.default_rng(3)
    speed = 30.0 + np.repeat(rng.normal(0.0, 1.0, 60), 10)  # a chattering driver: steps every 0.1 s
    x = np.cumsum(speed) * STEP
    rec, track = recording_of(x, np.where(np.arange(600) > 300, 1.6, 0.0))
    times = np.arange(1.0, 5.0, 0.0025)
    state = states(rec, track, times, MotionSettings())
    for axis in (0, 1):
        middle = (state[axis, 2:] - state[axis, :-2]) / 0.005
        np.testing.assert_allclose(state[axis + 2, 1:-1], middle, atol=2e-3)
        slope = (state[axis + 2, 2:] - state[axis + 2, :-2]) / 0.005
        np.testing.assert_allclose(state[axis + 4, 1:-1], slope, atol=2e-2)


def test_a_straight_drive_passes_unchanged_up_to_the_ends_of_the_track() -> None:
    t = np.arange(400) * STEP
    rec, track = recording_of(5.0 + 30.0 * t, 7.0 - 2.0 * t, first_step=1000)
    times = np.linspace(10.0, 13.99, 77)
    state = states(rec, track, times, MotionSettings())
    np.testing.assert_allclose(state[0], 5.0 + 30.0 * (times - 10.0), atol=1e-9)
    np.testing.assert_allclose(state[2:4], np.array([[30.0], [-2.0]]) + np.zeros((2, 77)), atol=1e-9)
    np.testing.assert_allclose(state[4:6], 0.0, atol=1e-7)


def test_an_instant_outside_the_track_is_refused() -> None:
    rec, track = recording_of(np.arange(400.0), np.zeros(400))
    with pytest.raises(ValueError, match="has no state"):
        states(rec, track, np.array([3.0, 4.5]), MotionSettings())
