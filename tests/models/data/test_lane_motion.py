"""The fits that smooth motion, against scipy's Savitzky-Golay filter."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from isac_cosim.models.data.lane_motion import slopes, smoothed


@given(st.integers(1, 40), st.integers(0, 60), st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_smoothing_at_some_instants_is_that_of_a_savitzky_golay_filter(
    half: int, more: int, order: int, seed: int
) -> None:
    span = 2 * half + 1
    count = span + more
    values = 1000.0 + np.random.default_rng(seed).normal(size=(3, count)).cumsum(axis=1)
    instants = (0, count // 3, count // 2, count - 1)
    oracle = savgol_filter(values, span, order, axis=1)
    np.testing.assert_allclose(smoothed(values, span, order, instants), oracle[:, list(instants)], atol=1e-8)
    steepest = savgol_filter(values, span, 1, deriv=1, axis=1)
    np.testing.assert_allclose(slopes(values, span).max(axis=1), steepest.max(axis=1), atol=1e-8)
    np.testing.assert_allclose(slopes(values, span), steepest[:, half : count - half], atol=1e-8)
