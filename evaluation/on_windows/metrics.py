"""How good predictions are: F1, confusion, dependence on lead time and SNR, paired differences.

Everything is counted from confusion matrices, rows true and columns predicted. The F1 of a class without a true sample
is undefined, reported as None; a macro-F1 is the mean over the classes that have one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.metrics import roc_auc_score

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.evaluation.on_windows.score_results import (
    ClassifiedWindows,
    ClassScores,
    Difference,
    LeadTimeBin,
    PairedDifference,
    PairScores,
    Separation,
    SnrBin,
    Spread,
    Summary,
)
from isac_cosim.evaluation.statistics import Statistic, jackknife_half_width

LEAD_BIN_S = 0.2
"""Width of a bin of lead time, s."""
SNR_BIN_DB = 2.0
"""Width of a bin of SNR, dB."""
LEAST_IN_BIN = 5
"""A class with fewer true windows is left out of a macro-F1: one window would weigh as much as a whole class."""

BoolArray = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.int64] | npt.NDArray[np.float64]


def confusion(label: IntArray, predicted: IntArray, n_classes: int) -> IntArray:
    """Count windows by true and predicted class.

    label, predicted: class numbers, (n,).
    Returns counts (n_classes, n_classes), rows true and columns predicted.
    """
    flat = np.bincount(label * n_classes + predicted, minlength=n_classes**2)
    return flat.reshape(n_classes, n_classes).astype(np.int64)


def f1_scores(counts: Counts) -> Array:
    """Return the F1 of each class of confusion matrices (..., G, G) as (..., G), NaN without a true sample.

    Source: ASI-BIP, Eq. (7).
    """
    hit = np.diagonal(counts, axis1=-2, axis2=-1).astype(np.float64)
    true, predicted = counts.sum(axis=-1), counts.sum(axis=-2)
    return np.where(true > 0, 2 * hit / np.maximum(true + predicted, 1), np.nan)


def macro_f1(counts: Counts, least: int = 1) -> Array:
    """Return the mean F1 over the classes with at least `least` true samples, (...) for matrices (..., G, G).

    NaN where no class has that many.
    """
    return _mean_f1(counts, counts.sum(axis=-1) >= least)


def in_mean(counts: Counts, classes: Sequence[str], least: int = 1) -> list[str]:
    """Return the names of the classes in the macro-F1 of a confusion matrix (G, G): those with enough true samples.

    classes: names of the G classes. least: as in `macro_f1`.
    """
    return [name for name, true in zip(classes, counts.sum(axis=1), strict=True) if true >= least]


def summary(label: IntArray, predicted: IntArray, classes: tuple[str, ...]) -> Summary:
    """Return accuracy, F1 and confusion of predictions.

    label, predicted: class numbers, (n,). classes: names of the G classes.
    """
    counts = confusion(label, predicted, len(classes))
    return Summary(
        n=len(label),
        accuracy=_accuracy(label, predicted),
        macro_f1=_number(macro_f1(counts)),
        macro_f1_over=in_mean(counts, classes),
        per_class_f1=dict(zip(classes, map(_number, f1_scores(counts)), strict=True)),
        confusion=counts.tolist(),
    )


def classified(
    label: IntArray, predicted: IntArray, groups: npt.NDArray[np.object_] | IntArray, classes: tuple[str, ...]
) -> ClassifiedWindows:
    """Return accuracy, macro-F1 with its interval, and scores by class.

    label, predicted: class numbers, (n,). groups: scenario seed of each window, (n,). classes: names of the G classes.
    A class with fewer than LEAST_IN_BIN windows is left out of the macro-F1.
    """
    counts = _by_group(label, predicted[None], groups, len(classes))[0]
    total = counts.sum(axis=0)
    value, low, high = macro_f1_interval(counts, LEAST_IN_BIN)
    f1 = f1_scores(total)
    return ClassifiedWindows(
        n=len(label),
        groups=len(counts),
        accuracy=_accuracy(label, predicted),
        macro_f1=value,
        macro_f1_low=low,
        macro_f1_high=high,
        macro_f1_over=in_mean(total, classes, LEAST_IN_BIN),
        per_class={
            name: ClassScores(n=int(n), recall=float(hit / n) if n else None, f1=_number(f1[k]))
            for k, (name, n, hit) in enumerate(zip(classes, total.sum(axis=1), np.diagonal(total), strict=True))
        },
    )


def summary_interval(
    label: IntArray, predicted: IntArray, groups: npt.NDArray[np.object_] | IntArray, n_classes: int
) -> tuple[int, float | None, float | None]:
    """Return the number of scenario seeds and the interval of the macro-F1 of `summary`, clipped to 0 and 1."""
    counts = _by_group(label, predicted[None], groups, n_classes)[0]
    _, low, high = macro_f1_interval(counts)
    return len(counts), low, high


def macro_f1_interval(counts: Counts, least: int = 1) -> tuple[float | None, float | None, float | None]:
    """Return the macro-F1 over the classes with at least `least` windows, with its 95 % interval over groups.

    counts: confusion matrices of g groups, (g, G, G). The bounds are None with fewer than two groups.
    """
    total = counts.sum(axis=0)
    kept = total.sum(axis=1) >= least
    if not kept.any():
        return None, None, None
    value = _mean_f1(total, kept)
    half_width = jackknife_half_width(_mean_f1(total - counts, kept))
    return _number(value), _number(np.maximum(value - half_width, 0.0)), _number(np.minimum(value + half_width, 1.0))


def pair_confusion(logits: Array, label: IntArray, classes: tuple[str, ...], pair: tuple[int, int]) -> PairScores:
    """Return how well two intentions are distinguished, on windows of these two only.

    logits: (n, G). label: class numbers, (n,). classes: names of the G classes. pair: numbers of the two intentions.
    Each window is predicted as the likelier of the two, whatever the other logits are.
    """
    in_pair = np.isin(label, pair)
    second = label[in_pair] == pair[1]
    margin = logits[in_pair, pair[1]] - logits[in_pair, pair[0]]
    counts = confusion(second.astype(np.int64), (margin > 0).astype(np.int64), 2)
    both_present = second.any() and not second.all()
    return PairScores(
        intentions=[classes[k] for k in pair],
        n=len(second),
        accuracy=_number(np.mean((margin > 0) == second)) if len(second) else None,
        confusion=counts.tolist(),
        auroc=float(roc_auc_score(second, margin)) if both_present else None,
    )


def bins(value: Array, width: float) -> Iterator[tuple[float, float, BoolArray]]:
    """Yield the lower bound, the upper bound and the rows (a mask) of each bin of a quantity (n,) that is not empty.

    Bounds are multiples of `width`.
    """
    # The tiny shift keeps values that are multiples of the width, but for rounding, in the bin they open.
    index = np.floor(value / width + 1e-6).astype(np.int64)
    for k in np.unique(index):
        yield round(float(k * width), 6), round(float((k + 1) * width), 6), index == k


def by_lead_time(
    lead_s: Array,
    label: IntArray,
    predicted: IntArray,
    classes: Sequence[str],
    separation: Callable[[BoolArray], Separation] | None = None,
) -> list[LeadTimeBin]:
    """Return scores against lead time, in bins of LEAD_BIN_S.

    lead_s: commit minus end of each window, s, (n,). label, predicted: class numbers, (n,). classes: names of the
    classes.
    separation: returns how well some of the windows, given as a mask, are separated from the unknown.
    """
    rows = []
    for from_s, to_s, in_bin in bins(lead_s, LEAD_BIN_S):
        unknown = separation(in_bin) if separation else Separation(auroc=None, fpr_at_95_recall=None)
        rows.append(
            LeadTimeBin(
                from_s=from_s,
                to_s=to_s,
                n=int(in_bin.sum()),
                **_of_bin(label[in_bin], predicted[in_bin], classes),
                auroc_unknown=unknown.auroc,
                fpr_at_95_recall=unknown.fpr_at_95_recall,
            )
        )
    return rows


def by_snr(snr_db: Array, label: IntArray, predicted: IntArray, classes: Sequence[str]) -> list[SnrBin]:
    """Return scores against the records' mean per-element SNR, in bins of SNR_BIN_DB.

    snr_db: of each window's record, dB, (n,); windows where it is not finite are left out.
    label, predicted: class numbers, (n,). classes: names of the classes.
    """
    finite = np.isfinite(snr_db)
    label, predicted = label[finite], predicted[finite]
    return [
        SnrBin(
            from_db=from_db,
            to_db=to_db,
            n=int(in_bin.sum()),
            **_of_bin(label[in_bin], predicted[in_bin], classes),
        )
        for from_db, to_db, in_bin in bins(snr_db[finite], SNR_BIN_DB)
    ]


def paired_difference(
    label: IntArray,
    first: IntArray,
    second: IntArray,
    groups: npt.NDArray[np.object_] | IntArray,
    classes: tuple[str, ...],
    least: int = 1,
) -> PairedDifference:
    """Return the F1 of the first predictor minus that of the second on the same windows, with 95 % intervals.

    label: class numbers, (n,). first, second: predictions (n,), or (k, n) of k trainings, whose mean scores are then
    compared. groups: scenario seed of each window, (n,). classes: names of the G classes. least: a class with fewer
    windows is left out of the macro-F1.

    The interval is that of `jackknife_half_width` over scenario seeds, because windows of the same traffic are not
    independent. It does not cover what another training would change; see `spread` for that.
    """
    counts = [_by_group(label, np.atleast_2d(predicted), groups, len(classes)) for predicted in (first, second)]
    totals = [of_predictor.sum(axis=1) for of_predictor in counts]
    kept = totals[0][0].sum(axis=1) >= least

    def difference(values: Callable[[Array], Array], without: bool) -> Array:
        """Return the difference of a score, over all groups (...), or without each group in turn, (g, ...)."""
        means = [
            values(total[:, None] - of_predictor if without else total).mean(axis=0)
            for total, of_predictor in zip(totals, counts, strict=True)
        ]
        return np.asarray(means[0] - means[1])

    def of_class(name: str, k: int) -> Difference:
        # A group in which the class neither occurs nor is predicted says nothing about its F1.
        informed = np.any([c[..., k, :].sum(axis=(0, 2)) + c[..., :, k].sum(axis=(0, 2)) > 0 for c in counts], axis=0)
        return _interval(
            difference(lambda c: f1_scores(c)[..., k], without=False),
            difference(lambda c: f1_scores(c)[..., k], without=True)[informed],
        )

    return PairedDifference(
        groups=counts[0].shape[1],
        macro_f1=_interval(
            difference(lambda c: _mean_f1(c, kept), without=False),
            difference(lambda c: _mean_f1(c, kept), without=True),
        ),
        macro_f1_over=in_mean(totals[0][0], classes, least),
        per_class_f1={name: of_class(name, k) for k, name in enumerate(classes)},
    )


def spread(values: Sequence[float | None]) -> Spread:
    """Return mean and sample standard deviation (n - 1) of a score over trainings; those without it are left out."""
    present = np.array([value for value in values if value is not None], dtype=np.float64)
    return Spread(
        mean=_number(present.mean()) if len(present) else None,
        sd=_number(present.std(ddof=1)) if len(present) > 1 else None,
        n=len(present),
    )


def _accuracy(label: IntArray, predicted: IntArray) -> float | None:
    return _number(np.mean(label == predicted)) if len(label) else None


def _of_bin(label: IntArray, predicted: IntArray, classes: Sequence[str]) -> dict[str, Any]:
    """Return accuracy and macro-F1 of the windows of a bin, by their names in its result."""
    counts = confusion(label, predicted, len(classes))
    return {
        "accuracy": _accuracy(label, predicted),
        "macro_f1": _number(macro_f1(counts, LEAST_IN_BIN)),
        "macro_f1_over": in_mean(counts, classes, LEAST_IN_BIN),
    }


def _by_group(
    label: IntArray, predicted: IntArray, groups: npt.NDArray[np.object_] | IntArray, n_classes: int
) -> Array:
    """Return confusion matrices (k, g, G, G) of predictions (k, n) in each of the g groups.

    groups: name of each window's group, (n,).
    """
    names, group = np.unique(groups.astype(str), return_inverse=True)
    counts = np.zeros((len(predicted), len(names), n_classes, n_classes))
    for k, of_training in enumerate(predicted):
        np.add.at(counts[k], (group, label, of_training), 1)
    return counts


def _mean_f1(counts: Counts, kept: BoolArray) -> Array:
    """Return the mean F1, (...), of matrices (..., G, G) over the kept classes, a mask (..., G), with a true sample."""
    f1 = np.where(kept, f1_scores(counts), np.nan)
    n = np.isfinite(f1).sum(axis=-1)
    return np.asarray(np.where(n > 0, np.nansum(f1, axis=-1) / np.maximum(n, 1), np.nan))


def _number(value: float | np.floating | Array) -> float | None:
    """Return a plain float of a NumPy scalar or array without dimensions, None for NaN."""
    return float(value) if np.isfinite(value) else None


def _interval(difference: Array, left_out: Array) -> Difference:
    """Return a difference with its interval; left_out: the same without each group in turn, (g,)."""
    half_width = jackknife_half_width(left_out)
    return Difference(
        difference=_number(difference),
        low=_number(np.maximum(difference - half_width, -1.0)),
        high=_number(np.minimum(difference + half_width, 1.0)),
    )


def accuracy(counts: Array) -> float:
    """Return the share of windows on the diagonal of a confusion matrix (G, G), NaN without windows."""
    return float(np.trace(counts) / counts.sum()) if counts.sum() else float("nan")


def mean_f1(counts: Array) -> float:
    """Return the macro-F1 of a confusion matrix (G, G). Source: ASI-BIP, Eq. (7)."""
    return float(macro_f1(counts))


def class_f1(number: int) -> Statistic:
    """Return the statistic that is the F1 of the class of that number."""
    return lambda counts: float(f1_scores(counts)[number])


def lead_over_others(number: int) -> Statistic:
    """Return the statistic that is the F1 of the class of that number minus the highest among the other classes."""

    def lead(counts: Array) -> float:
        f1 = f1_scores(counts)
        return float(f1[number] - np.nanmax(np.delete(f1, number)))

    return lead


def lead_of_others(number: int) -> Statistic:
    """Return the statistic that is the lowest F1 among the other classes minus that of the class of that number.

    It is positive where that class is the weakest.
    """

    def lead(counts: Array) -> float:
        f1 = f1_scores(counts)
        return float(np.nanmin(np.delete(f1, number)) - f1[number])

    return lead
