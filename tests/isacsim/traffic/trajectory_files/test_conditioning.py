"""Positions are smoothed as much as their noise asks for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from isac_cosim.isacsim.traffic.trajectory_files.conditioning import (
    Sampling,
    acceleration_noise,
    noise_of_rounding,
    rounding_of,
    width_for,
)


@pytest.mark.parametrize(("noise_m", "rate_hz", "width_s"), [(0.1, 10.0, 0.3), (0.05, 25.0, 0.2), (0.02, 100.0, 0.15)])
def test_the_noise_that_smoothing_leaves_is_that_of_the_formula(noise_m: float, rate_hz: float, width_s: float) -> None:
    noise = np.random.default_rng(1).normal(0.0, noise_m, 400_000)
    left = gaussian_filter1d(noise, width_s * rate_hz, order=2) * rate_hz**2
    assert left.std() == pytest.approx(acceleration_noise(noise_m, rate_hz, width_s), rel=0.03)


def test_widths_for_the_files_that_there_are() -> None:
    assert width_for(noise_of_rounding(0.01), 25.0) == 0.15
    assert acceleration_noise(noise_of_rounding(0.01), 25.0, 0.15) == pytest.approx(0.03, abs=0.002)
    assert width_for(0.1, 10.0) == pytest.approx(0.3, abs=0.005)
    assert acceleration_noise(0.1, 10.0, 0.15) == pytest.approx(1.66, abs=0.02)


@settings(deadline=None)
@given(st.floats(0.001, 1.0), st.floats(1.0, 100.0))
def test_the_chosen_width_leaves_no_more_than_is_put_up_with(noise_m: float, rate_hz: float) -> None:
    assert acceleration_noise(noise_m, rate_hz, width_for(noise_m, rate_hz)) <= 0.3 + 1e-9
    assert Sampling.of(1.0 / rate_hz, noise_m).total_width_s >= width_for(noise_m, rate_hz) * (1 - 1e-9)


@settings(deadline=None)
@given(st.integers(0, 4), st.lists(st.floats(-1e5, 1e5), min_size=20, max_size=50))
def test_the_rounding_of_a_column_is_found(decimals: int, values: list[float]) -> None:
    column = np.round(np.array(values), decimals)
    assert rounding_of(column) >= 10.0**-decimals * (1 - 1e-9)


def test_a_column_that_is_not_rounded() -> None:
    assert rounding_of(np.random.default_rng(2).normal(0.0, 1.0, 100)) == 0.0


@settings(deadline=None)
@given(st.sampled_from([0.02, 0.04, 0.1, 0.2]), st.floats(0.0, 0.1), st.sets(st.integers(5, 25), max_size=4))
def test_steady_acceleration_is_kept_over_gaps(period_s: float, noise_m: float, missing: set[int]) -> None:
    """Half the kernel's reach inside, where its ends are not seen."""
    sampling = Sampling.of(period_s, noise_m)
    step = np.array([k for k in range(400) if k not in missing])
    time = step * period_s
    x, v = sampling.motion(step, 3.0 + 20.0 * time - 0.7 * time**2)
    times = np.arange(len(x)) * sampling.step_s
    assert len(x) == 399 * sampling.per_step + 1
    inner = slice(int(3.0 / sampling.step_s), -int(3.0 / sampling.step_s))
    assert len(times[inner]) > 50
    # A Gaussian moves a parabola by half its second derivative times the variance of the kernel.
    assert np.abs(x + 0.7 * sampling.width_s**2 - (3.0 + 20.0 * times - 0.7 * times**2))[inner].max() < 1e-5
    assert np.abs(v - (20.0 - 1.4 * times))[inner].max() < 1e-4
