"""Intervals over scenario seeds that also cover where there are few seeds.

Windows of the same traffic are not independent, so the scenario seed is the unit. A percentile bootstrap over a handful
of seeds is too narrow; the delete-one jackknife with a t quantile is not (`tests/models/evaluation/test_intervals.py`
simulates the coverage of both).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student_t

from isacsim.arrays import Array, BoolArray

LEVEL = 0.95
"""Coverage that the intervals are made for."""


def jackknife_half_width(left_out: Array, level: float = LEVEL) -> Array:
    """Return half the width of the interval of a statistic over g independent groups.

    left_out: (g, ...), the statistic of all groups but one, for each group in turn. level: coverage of the interval.
    Returns the t quantile with g - 1 degrees of freedom times the jackknife standard error, (...); NaN where there are
    fewer than two groups or the statistic is undefined without one of them.
    Source: Efron & Tibshirani 1993, Eq. (11.5); Tukey 1958 for the t quantile.
    """
    count = len(left_out)
    if count < 2:
        return np.full(left_out.shape[1:], np.nan)
    deviation = left_out - left_out.mean(axis=0)
    standard_error = np.sqrt((count - 1) / count * (deviation**2).sum(axis=0))
    return np.asarray(student_t.ppf((1 + level) / 2, count - 1) * standard_error)


def jackknife_interval(
    statistic: Callable[[BoolArray], float], groups: npt.NDArray[np.object_]
) -> tuple[float | None, float | None, float | None]:
    """Return a score between 0 and 1 of n windows, with its LEVEL interval over groups.

    statistic: the score of some of the windows, a mask (n,); NaN where it is undefined. groups: scenario seed of each
    window, (n,). The bounds are None where `jackknife_half_width` is undefined, the score where it is itself.
    """
    value = statistic(np.ones(len(groups), dtype=bool))
    half_width = float(jackknife_half_width(np.array([statistic(groups != name) for name in sorted(set(groups))])))
    bounds = (value, max(value - half_width, 0.0), min(value + half_width, 1.0))
    if np.isnan(value):
        return None, None, None
    return bounds if np.isfinite(half_width) else (value, None, None)
