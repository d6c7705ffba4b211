"""Scores with their uncertainty, from confusion matrices by scenario seed and training.

A stage keeps a confusion matrix for every test seed and every training, and no predictions: every score, difference and
interval of a reproduction can be computed from these again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.stats import t as student_t

from isacsim.arrays import Array, IntArray
from isacsim.settings import Settings
from models.evaluation.intervals import LEVEL
from models.evaluation.metrics import f1_scores, macro_f1, maneuver_scores

Counts = list[list[int]]
"""A confusion matrix, rows true and columns predicted."""
Trainings = Sequence[Mapping[str, Counts]]
"""Confusion matrices of one condition: for every training, by test seed."""
Statistic = Callable[..., float]
"""Computes one number from the confusion matrix of each condition, (G, G) arrays."""


class Estimate(Settings):
    """A number measured on several test seeds, with one or more trainings.

    value: mean over the trainings; None where it is undefined. low, high: 95 % interval; None where it cannot be given.
    sd: sample standard deviation over the trainings; None with a single one. over: of a mean over classes of which some
    have no window, the number of those in it and of all; otherwise None.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    sd: float | None = None
    over: tuple[int, int] | None = None


def estimate(statistic: Statistic, *conditions: Trainings) -> Estimate:
    """Return a statistic of one or more conditions, on the test seeds that all of them share.

    Training k of a condition is compared with training k of the others. The interval covers both sources of
    uncertainty: its variance is that of the delete-one jackknife over the test seeds plus that of the mean over the
    trainings, and its degrees of freedom are those of Welch and Satterthwaite. With a single training it covers the
    test seeds alone.
    """
    trainings = min(len(condition) for condition in conditions)
    shared = set.intersection(*(set(counts) for condition in conditions for counts in condition[:trainings]))
    groups = sorted(shared)
    if not groups or not trainings:
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
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    half_width = _half_width(left_out.mean(axis=0), values)
    bounds = (value - half_width, value + half_width) if np.isfinite(half_width) else (None, None)
    return Estimate(value=value, low=bounds[0], high=bounds[1], sd=sd)


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


def _half_width(left_out: Array, values: Array) -> float:
    """Return half the width of the interval of a mean, NaN with fewer than two test seeds.

    left_out: the statistic without each test seed in turn, (g,). values: of each training, (k,).
    """
    g, k = len(left_out), len(values)
    if g < 2:
        return float("nan")
    of_seeds = (g - 1) / g * float(((left_out - left_out.mean()) ** 2).sum())
    of_trainings = float(values.var(ddof=1)) / k if k > 1 else 0.0
    if of_seeds + of_trainings == 0:
        return 0.0
    terms = of_seeds**2 / (g - 1) + (of_trainings**2 / (k - 1) if k > 1 else 0.0)
    freedom = (of_seeds + of_trainings) ** 2 / terms
    return float(student_t.ppf((1 + LEVEL) / 2, freedom) * np.sqrt(of_seeds + of_trainings))


def accuracy(counts: Array) -> float:
    """Return the share of windows on the diagonal of a confusion matrix (G, G), NaN without windows."""
    return float(np.trace(counts) / counts.sum()) if counts.sum() else float("nan")


def mean_f1(counts: Array) -> float:
    """Return the macro-F1 of a confusion matrix (G, G). Source: ASI-BIP, Eq. (7)."""
    return float(macro_f1(counts))


def maneuver_f1(counts: Array) -> float:
    """Return the F1 of macro precision and macro recall over maneuvers. Source: CaSTFormer, Eq. (13)."""
    f1 = maneuver_scores(counts).f1
    return float("nan") if f1 is None else f1


def class_f1(number: int) -> Statistic:
    """Return the statistic that is the F1 of the class of that number."""
    return lambda counts: float(f1_scores(counts)[number])


def difference(statistic: Statistic) -> Statistic:
    """Return the statistic that is a score of the first condition minus that of the second."""
    return lambda first, second: statistic(first) - statistic(second)


def relative_gain(statistic: Statistic) -> Statistic:
    """Return the statistic that is the gain of the first condition over the second, as a share of the second."""

    def gain(first: Array, second: Array) -> float:
        floor = statistic(second)
        return (statistic(first) - floor) / floor if floor > 0 else float("nan")

    return gain


def lead_of_others(number: int) -> Statistic:
    """Return the statistic that is the lowest F1 among the other classes minus that of the class of that number.

    It is positive where that class is the weakest.
    """

    def lead(counts: Array) -> float:
        f1 = f1_scores(counts)
        return float(np.nanmin(np.delete(f1, number)) - f1[number])

    return lead


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
