"""Intervals over scenario seeds that also cover where there are few seeds.

Windows of the same traffic are not independent, so the scenario seed is the unit. A percentile bootstrap over a handful
of seeds is too narrow; the delete-one jackknife with a t quantile is not (`tests/evaluation/test_intervals.py`
simulates the coverage of both).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.stats import t as student_t

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.settings import Settings

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


Counts = list[list[int]]
"""A confusion matrix, rows true and columns predicted."""


Trainings = Sequence[Mapping[str, Counts]]
"""Confusion matrices of one condition: for every training, by test seed."""


Statistic = Callable[..., float]
"""Computes one number from the confusion matrix of each condition, (G, G) arrays."""


class Interval(Settings):
    """A t interval of the delete-one jackknife over seeds.

    seeds: their number; None in results of earlier versions, whose intervals are percentiles of a bootstrap.
    """

    low: float
    high: float
    seeds: int | None = None


class Estimate(Settings):
    """A number measured on several test seeds, with one or more trainings.

    value: mean over the trainings; None where it is undefined. low, high: 95 % interval; None where it cannot be given.
    sd: sample standard deviation over the trainings; None with a single one. over: of a mean over classes of which some
    have no window, the number of those in it and of all; otherwise None. standard_error, freedom: behind the interval,
    with the degrees of freedom of its t quantile; not written to files.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    sd: float | None = None
    over: tuple[int, int] | None = None
    standard_error: float | None = Field(None, exclude=True)
    freedom: float | None = Field(None, exclude=True)


def estimate(statistic: Statistic, *conditions: Trainings) -> Estimate:
    """Return a statistic of one or more conditions, on the test seeds that all of them share.

    Training k of a condition is compared with training k of the others. The interval covers both sources of
    uncertainty: its variance is that of the delete-one jackknife over the test seeds plus that of the mean over the
    trainings, and its degrees of freedom are those of Welch and Satterthwaite. With a single training it covers the
    test seeds alone.
    """
    trainings = min(len(condition) for condition in conditions)
    if not trainings:
        return Estimate(value=None)
    shared = set.intersection(*(set(counts) for condition in conditions for counts in condition[:trainings]))
    groups = sorted(shared)
    if not groups:
        return Estimate(value=None)
    stacks = [
        np.array([[counts[group] for group in groups] for counts in condition[:trainings]], dtype=np.float64)
        for condition in conditions
    ]
    totals = [stack.sum(axis=1) for stack in stacks]
    values = np.array([statistic(*(total[k] for total in totals)) for k in range(trainings)])
    left_out = np.array(
        [
            [
                statistic(*(total[k] - stack[k, j] for total, stack in zip(totals, stacks, strict=True)))
                for j in range(len(groups))
            ]
            for k in range(trainings)
        ]
    )
    return of_left_out(values, left_out)


def of_left_out(values: Array, left_out: Array) -> Estimate:
    """Return the estimate of a statistic, with the interval of `estimate`.

    values: of each training, (k,). left_out: of each training without each of the test seeds in turn, (k, g).
    """
    value = float(values.mean())
    if not np.isfinite(value):
        return Estimate(value=None)
    return _with_interval(values, *_error(left_out.mean(axis=0), values))


def over_trainings(values: Array) -> Estimate:
    """Return the mean of a statistic over trainings, with an interval that covers these alone; values: (k,)."""
    count = len(values)
    if count < 2 or not np.isfinite(values).all():
        return Estimate(value=float(values.mean()) if count and np.isfinite(values).all() else None)
    return _with_interval(values, float(values.std(ddof=1) / np.sqrt(count)), count - 1)


def _with_interval(values: Array, error: float, freedom: float) -> Estimate:
    """Return the mean of a statistic over trainings, (k,), with the interval of a standard error, if there is one."""
    value = float(values.mean())
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    if not np.isfinite(error):
        return Estimate(value=value, sd=sd)
    half_width = float(student_t.ppf((1 + LEVEL) / 2, freedom) * error) if error > 0 else 0.0
    return Estimate(
        value=value, low=value - half_width, high=value + half_width, sd=sd, standard_error=error, freedom=freedom
    )


def score(statistic: Statistic, counts: Trainings) -> Estimate:
    """Return a score of one condition, between 0 and 1, and so its interval."""
    return between_0_and_1(estimate(statistic, counts))


def class_mean(statistic: Statistic, counts: Trainings) -> Estimate:
    """Return a score that is a mean over classes, and over how many of them, where some have no window."""
    result = score(statistic, counts)
    if result.value is None:
        return result
    true = pooled(counts).sum(axis=1)
    present = int((true > 0).sum())
    return result if present == len(true) else result.model_copy(update={"over": (present, len(true))})


def between_0_and_1(result: Estimate) -> Estimate:
    """Return an estimate with its interval cut to what a score can be."""
    low, high = (None if bound is None else min(max(bound, 0.0), 1.0) for bound in (result.low, result.high))
    return result.model_copy(update={"low": low, "high": high})


def _error(left_out: Array, values: Array) -> tuple[float, float]:
    """Return the standard error of a mean and its degrees of freedom, NaN with fewer than two test seeds.

    left_out: the statistic without each test seed in turn, (g,). values: of each training, (k,).
    """
    g, k = len(left_out), len(values)
    if g < 2:
        return float("nan"), 0.0
    of_seeds = (g - 1) / g * float(((left_out - left_out.mean()) ** 2).sum())
    of_trainings = float(values.var(ddof=1)) / k if k > 1 else 0.0
    if of_seeds + of_trainings == 0:
        return 0.0, 1.0
    terms = of_seeds**2 / (g - 1) + (of_trainings**2 / (k - 1) if k > 1 else 0.0)
    freedom = (of_seeds + of_trainings) ** 2 / terms
    return float(np.sqrt(of_seeds + of_trainings)), freedom


def difference(statistic: Statistic) -> Statistic:
    """Return the statistic that is a score of the first condition minus that of the second."""
    return lambda first, second: statistic(first) - statistic(second)


def relative_gain(statistic: Statistic) -> Statistic:
    """Return the statistic that is the gain of the first condition over the second, as a share of the second."""

    def gain(first: Array, second: Array) -> float:
        floor = statistic(second)
        return (statistic(first) - floor) / floor if floor > 0 else float("nan")

    return gain


def span(statistic: Statistic) -> Statistic:
    """Return the statistic that is the largest score among the conditions minus the smallest."""

    def largest_minus_smallest(*conditions: Array) -> float:
        scores = [statistic(counts) for counts in conditions]
        return max(scores) - min(scores)

    return largest_minus_smallest


def pooled(trainings: Trainings) -> IntArray:
    """Return the confusion matrix of all test seeds and trainings together, (G, G)."""
    matrices = [counts for training in trainings for counts in training.values()]
    return np.asarray(np.sum(matrices, axis=0), dtype=np.int64)
