"""When sampled signals cross levels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.labeling.detectors.threshold_crossings import excursions, first_below, intervals_above, last_below

T = np.arange(0.0, 10.0, 0.1)


@given(level=st.floats(-0.9, 0.9), rate=st.sampled_from([0.02, 0.05, 0.1]))
@settings(max_examples=30, deadline=None)
def test_a_sine_is_above_a_level_in_the_same_intervals_at_any_rate(level: float, rate: float) -> None:
    times = np.arange(0.0, 4 * np.pi, rate)
    rise = np.arcsin(level)
    expected = [(rise + 2 * np.pi * k, np.pi - rise + 2 * np.pi * k) for k in (0, 1)]
    intervals = intervals_above(times, np.sin(times), level)
    whole = [(start, stop) for start, stop in intervals if start > 0 and stop < times[-1]]
    assert np.allclose(whole, [(start, stop) for start, stop in expected if start > 0], atol=rate**2)


def test_intervals_cut_off_by_the_ends_reach_them() -> None:
    assert intervals_above(T, np.ones_like(T), 0.5) == [(T[0], T[-1])]
    assert intervals_above(T, np.zeros_like(T), 0.5) == []


def test_last_and_first_below_are_interpolated() -> None:
    values = np.abs(T - 5.0)
    assert last_below(T, -values, -2.0, 5.0) == pytest.approx(3.0)
    assert first_below(T, -values, -2.0, 5.0) == pytest.approx(7.0)
    assert last_below(T, values, -1.0, 5.0) is None
    assert first_below(T, values, -1.0, 5.0) is None


def trapezoid(rise: float, top: float, hold: float) -> tuple[np.ndarray, np.ndarray]:
    times = np.arange(0.0, 20.0, 0.05)
    return times, np.interp(times, [5.0, 5.0 + rise, 5.0 + rise + hold, 5.0 + 2 * rise + hold], [0.0, top, top, 0.0])


def test_excursion_times_of_a_trapezoid() -> None:
    times, values = trapezoid(2.0, 4.0, 3.0)
    (excursion,) = excursions(times, values, level=3.0, hold_s=1.0, rest=0.5, trace_back_s=5.0)
    assert excursion.onset == pytest.approx(5.25)
    assert excursion.commit == pytest.approx(6.5)
    assert excursion.end == pytest.approx(11.75)
    assert excursion.peak == pytest.approx(4.0)


def test_an_excursion_that_is_not_held_does_not_count() -> None:
    times, values = trapezoid(2.0, 4.0, 3.0)
    assert excursions(times, values, 3.0, hold_s=4.1, rest=0.5, trace_back_s=5.0) == []
    assert len(excursions(times, values, 3.0, hold_s=3.9, rest=0.5, trace_back_s=5.0)) == 1


def test_an_excursion_is_traced_back_up_to_the_limit() -> None:
    times, values = trapezoid(2.0, 4.0, 3.0)
    (excursion,) = excursions(times, values, 3.0, 1.0, 0.5, trace_back_s=0.6)
    assert excursion.onset == pytest.approx(6.5 - 0.6)


def test_excursions_without_rest_in_between_are_one() -> None:
    times = np.arange(0.0, 20.0, 0.05)
    corners = [2.0, 3.0, 5.0, 6.0, 7.0, 9.0, 10.0]
    joined = np.interp(times, corners, [0.0, 5.0, 5.0, 1.0, 6.0, 6.0, 0.0])
    parted = np.interp(times, corners, [0.0, 5.0, 5.0, 0.0, 6.0, 6.0, 0.0])
    (one,) = excursions(times, joined, 4.0, 1.0, 0.5, 3.0)
    assert one.peak == pytest.approx(6.0)
    assert len(excursions(times, parted, 4.0, 1.0, 0.5, 3.0)) == 2
