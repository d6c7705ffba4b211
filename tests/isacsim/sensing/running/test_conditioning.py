"""Kernels of running traffic: exact on simple motion, causal where they say so, equal to the open loop's inside."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.isacsim.sensing.running.conditioning import Conditioning, Kernel, conditioned
from isac_cosim.isacsim.traffic.motion import MotionSettings, condition

STEP_S, WIDTH_S = 0.01, 0.15


def state_at(kernel: Kernel, positions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    weights = kernel.weights(rows, positions.shape[-1])
    return conditioned(positions[None], weights)[0]


def test_trailing_is_the_open_loops_conditioning_up_to_the_weight_that_is_cut_off() -> None:
    rng = np.random.default_rng(1)
    acceleration = np.repeat(rng.uniform(-4.0, 2.0, (2, 40)), 10, axis=1)  # a driver's decisions, ten a second
    positions = np.cumsum(30.0 * STEP_S + np.cumsum(acceleration, axis=1) * STEP_S**2, axis=1)
    kernel, rows = Kernel("trailing", WIDTH_S, STEP_S), np.array([150.0, 200.25, 240.5])
    state = state_at(kernel, positions, rows)
    for order in range(3):
        for axis in range(2):
            exact = condition(positions[axis], STEP_S, WIDTH_S, order, rows)
            scale = np.abs(condition(positions[axis], STEP_S, WIDTH_S, order)).max()
            np.testing.assert_allclose(state[2 * order + axis], exact, atol=(1e-5, 1e-4, 5e-3)[order] * scale)


@pytest.mark.parametrize("kind", ["trailing", "causal"])
def test_constant_acceleration_is_kept(kind: Conditioning) -> None:
    kernel = Kernel(kind, WIDTH_S, STEP_S)
    time = np.arange(300) * STEP_S
    positions = np.stack([30.0 * time - time**2, 2.0 * time])
    rows = np.array([200.0, 220.75])
    state = state_at(kernel, positions, rows)
    seen_s = rows * STEP_S - (0.0 if kind == "trailing" else kernel.age_s)
    np.testing.assert_allclose(state[2], 30.0 - 2.0 * seen_s, atol=1e-3)
    np.testing.assert_allclose(state[4], -2.0, atol=1e-6)
    np.testing.assert_allclose(state[1], 2.0 * seen_s, atol=1e-3)


def test_the_kernels_need_nothing_from_the_future() -> None:
    for kind in ("trailing", "causal"):
        kernel = Kernel(kind, WIDTH_S, STEP_S)
        now = kernel.behind_rows
        count = now + kernel.ahead_rows + 1
        weights = kernel.weights(np.array([float(now)]), count + 50)
        assert (weights[:, :, count:] == 0.0).all()
    assert Kernel("causal", WIDTH_S, STEP_S).lag_s == 0.0
    assert Kernel("trailing", WIDTH_S, STEP_S).lag_s == pytest.approx(4 * WIDTH_S)
    assert MotionSettings().width_s == WIDTH_S


def test_the_causal_kernel_has_the_spread_and_the_age_that_it_says() -> None:
    kernel = Kernel("causal", WIDTH_S, STEP_S)
    (value,) = kernel.weights(np.array([200.0]), 201)[0]
    age = (200 - np.arange(201)) * STEP_S
    mean = (value * age).sum()
    assert mean == pytest.approx(kernel.age_s, rel=1e-3)
    assert np.sqrt((value * (age - mean) ** 2).sum()) == pytest.approx(WIDTH_S, rel=1e-2)
