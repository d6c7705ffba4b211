"""Signals continued beyond their ends, against numpy's own padding."""

import numpy as np
import pytest

from isac_cosim.base.arrays import reflected


@pytest.mark.parametrize("count", [1, 2, 5, 8, 300])
@pytest.mark.parametrize(("before", "after"), [(0, 0), (1, 0), (4, 7), (7, 4), (8, 8), (240, 120)])
def test_a_signal_is_continued_as_numpy_pads_it_to_the_last_bit(count: int, before: int, after: int) -> None:
    rng = np.random.default_rng(1)
    real = rng.normal(size=count).cumsum()
    for values in (real, real + 1j * rng.normal(size=count)):
        expected = np.pad(values, (before, after), mode="reflect", reflect_type="odd")
        np.testing.assert_array_equal(reflected(values, before, after), expected, strict=True)
