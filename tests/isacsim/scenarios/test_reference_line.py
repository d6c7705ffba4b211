"""The widths of a rounded line, against the plain computation that looks at the whole line in every round."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios import reference_line
from isac_cosim.isacsim.scenarios.reference_line import STEP_M, Smoothing, acceleration, rounding_widths


def widest_level_by_level(line: Smoothing, max_shift_m: float) -> Array:
    """Return what `Smoothing.widest` returns, from one kernel width after the other."""
    result = np.full(len(line.values), line.widths_m[-1])
    ended, before = np.zeros(len(line.values), bool), np.zeros(len(line.values))
    line._compute(np.arange(len(line.widths_m)))
    for (low, high), level in zip(pairwise(line.widths_m), line._levels[1:], strict=True):
        moved = np.abs(level - line.values)
        ends = ~ended & (moved > max_shift_m)
        share = (max_shift_m - before[ends]) / (moved[ends] - before[ends])
        result[ends] = np.sqrt(low**2 + share * (high**2 - low**2))
        ended |= ends
        before = moved
    return result


def widths_from_the_whole_line(
    line: Smoothing, speeds: Array, width_s: float, limit_mps2: float, max_shift_m: float
) -> Array:
    """Return what `rounding_widths` returns; every round smooths all of the line anew."""
    need = np.zeros(len(speeds))
    widest = widest_level_by_level(line, max_shift_m)
    roof = -reference_line._envelope(-widest)
    widths = need.copy()
    for _ in range(reference_line.ROUNDS):
        short = acceleration(line, widths, speeds, width_s) > limit_mps2
        short &= (widths < 0.98 * roof) & (need < line.widths_m[-1])
        if not short.any():
            break
        wider = reference_line.GROWTH * np.maximum(need, widths)[short]
        need[short] = np.clip(wider, 1.0, line.widths_m[-1])
        widths = reference_line._blended(np.minimum(reference_line._envelope(need), roof))
    return np.minimum(widths, widest)


@settings(max_examples=40, deadline=None)
@given(
    turns=st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=6),
    speed=st.floats(3.0, 40.0),
    slower=st.floats(0.1, 1.0),
    max_shift_m=st.sampled_from([0.0, 0.1, 1.0]),
)
def test_a_line_is_rounded_to_the_last_bit_as_if_all_of_it_were_smoothed_in_every_round(
    turns: list[float], speed: float, slower: float, max_shift_m: float
) -> None:
    headings = np.repeat(np.radians(np.concatenate([[0.0], np.cumsum(turns)])), 160)
    points = np.cumsum(STEP_M * np.exp(1j * headings))
    speeds = speed * np.linspace(1.0, slower, len(points))
    arguments = (speeds, 0.15, 3.5, max_shift_m)
    widths = rounding_widths(Smoothing(points), *arguments)
    np.testing.assert_array_equal(widths, widths_from_the_whole_line(Smoothing(points), *arguments))
