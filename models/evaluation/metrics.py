"""What a predictor's answers are worth: F1, confusion, dependence on lead time and SNR, paired differences.

Everything is counted from confusion matrices, rows true and columns predicted. The F1 of a class without a true sample
is undefined: it is None, and a macro-F1 is the mean over the classes that have one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.metrics import roc_auc_score

from isacsim.arrays import Array, IntArray
from isacsim.seeding import stream

LEAD_BIN_S = 0.2
SNR_BIN_DB = 2.0
LEAST_IN_BIN = 5
"""A class with fewer true windows in a bin stays out of its macro-F1: one window would weigh as much as a class."""


def confusion(label: IntArray, predicted: IntArray, n_classes: int) -> IntArray:
    """Counts (n_classes, n_classes), rows true, columns predicted."""
    flat = np.bincount(label * n_classes + predicted, minlength=n_classes**2)
    return flat.reshape(n_classes, n_classes).astype(np.int64)


def f1_scores(counts: npt.NDArray[Any]) -> Array:
    """F1 of each class of confusion matrices (..., G, G): (..., G), NaN without a true sample. ASI-BIP, Eq. (7)."""
    hit = np.diagonal(counts, axis1=-2, axis2=-1).astype(np.float64)
    true, predicted = counts.sum(axis=-1), counts.sum(axis=-2)
    return np.where(true > 0, 2 * hit / np.maximum(true + predicted, 1), np.nan)


def macro_f1(counts: npt.NDArray[Any], least: int = 1) -> Array:
    """Mean F1 over the classes with at least `least` true samples, (...) of (..., G, G); NaN without any."""
    f1 = np.where(counts.sum(axis=-1) >= least, f1_scores(counts), np.nan)
    n = np.isfinite(f1).sum(axis=-1)
    return np.asarray(np.where(n > 0, np.nansum(f1, axis=-1) / np.maximum(n, 1), np.nan))


def summary(label: IntArray, predicted: IntArray, classes: tuple[str, ...]) -> dict[str, Any]:
    """`n`, `accuracy`, `macro_f1`, `per_class_f1` and `confusion` of answers (n,)."""
    counts = confusion(label, predicted, len(classes))
    return {
        "n": len(label),
        "accuracy": number(np.mean(label == predicted)) if len(label) else None,
        "macro_f1": number(macro_f1(counts)),
        "per_class_f1": dict(zip(classes, map(number, f1_scores(counts)), strict=True)),
        "confusion": counts.tolist(),
    }


def maneuver_scores(counts: npt.NDArray[Any], background: int | None = None) -> dict[str, float | None]:
    """`precision`, `recall` and their `f1` over maneuvers, of a confusion matrix (G, G). CaSTFormer, Eq. (13).

    background: the class that is no maneuver, if any: its row gives false predictions, a maneuver taken for it is
    missed. Every miss counts in the recall, a confusion with another maneuver too. A maneuver without a true sample is
    left out; one that is never predicted has precision 0.
    """
    hit = np.diagonal(counts).astype(np.float64)
    true, predicted = counts.sum(axis=1), counts.sum(axis=0)
    kept = true > 0
    if background is not None:
        kept[background] = False
    if not kept.any():
        return {"precision": None, "recall": None, "f1": None}
    precision = float(np.mean(hit[kept] / np.maximum(predicted[kept], 1)))
    recall = float(np.mean(hit[kept] / true[kept]))
    f1 = 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
    return {"precision": precision, "recall": recall, "f1": f1}


def pair_confusion(logits: Array, label: IntArray, classes: tuple[str, ...], pair: tuple[int, int]) -> dict[str, Any]:
    """How well two intentions are told from each other, where there are no others.

    Windows (n,) whose true intention is one of the pair, each answered by the likelier of the two. `confusion` (2, 2)
    has rows true; `auroc` is that of the second against the first, by the difference of their logits.
    """
    here = np.isin(label, pair)
    second = label[here] == pair[1]
    margin = logits[here, pair[1]] - logits[here, pair[0]]
    counts = confusion(second.astype(np.int64), (margin > 0).astype(np.int64), 2)
    both = second.any() and not second.all()
    return {
        "intentions": [classes[k] for k in pair],
        "n": len(second),
        "accuracy": number(np.mean((margin > 0) == second)) if len(second) else None,
        "confusion": counts.tolist(),
        "auroc": float(roc_auc_score(second, margin)) if both else None,
    }


def bins(value: Array, width: float, unit: str) -> Iterator[tuple[dict[str, Any], npt.NDArray[np.bool_]]]:
    """Bins of a quantity (n,), multiples of `width`: `from_<unit>`, `to_<unit>` and `n` of each, and its rows."""
    # The tiny shift keeps values that are multiples of the width, but for rounding, in the bin they open.
    place = np.floor(value / width + 1e-6).astype(np.int64)
    for k in np.unique(place):
        here = place == k
        ends = {f"from_{unit}": round(float(k * width), 6), f"to_{unit}": round(float((k + 1) * width), 6)}
        yield {**ends, "n": int(here.sum())}, here


def by_bin(
    value: Array,
    width: float,
    unit: str,
    label: IntArray,
    predicted: IntArray,
    n_classes: int,
    more: Callable[[npt.NDArray[np.bool_]], dict[str, Any]] | None = None,
) -> list[dict[str, Any]]:
    """`bins` with `accuracy` and `macro_f1` of each; more: further entries, of the rows of a bin."""
    rows = []
    for row, here in bins(value, width, unit):
        counts = confusion(label[here], predicted[here], n_classes)
        row["accuracy"] = number(np.mean(label[here] == predicted[here]))
        row["macro_f1"] = number(macro_f1(counts, LEAST_IN_BIN))
        rows.append(row | (more(here) if more else {}))
    return rows


def by_lead_time(
    lead_s: Array,
    label: IntArray,
    predicted: IntArray,
    n_classes: int,
    more: Callable[[npt.NDArray[np.bool_]], dict[str, Any]] | None = None,
) -> list[dict[str, Any]]:
    """Scores against lead time (commit minus window end, s), in steps of LEAD_BIN_S; more: as in `by_bin`."""
    return by_bin(lead_s, LEAD_BIN_S, "s", label, predicted, n_classes, more)


def by_snr(snr_db: Array, label: IntArray, predicted: IntArray, n_classes: int) -> list[dict[str, Any]]:
    """Scores against the records' mean per-element SNR, in steps of SNR_BIN_DB; records without one are left out."""
    has = np.isfinite(snr_db)
    return by_bin(snr_db[has], SNR_BIN_DB, "db", label[has], predicted[has], n_classes)


def paired_difference(
    label: IntArray,
    first: IntArray,
    second: IntArray,
    groups: npt.NDArray[Any],
    classes: tuple[str, ...],
    draws: int = 2000,
) -> dict[str, Any]:
    """Macro-F1 and per-class F1 of the first predictor minus the second's on the same windows, with 95 % intervals.

    first, second: answers (n,), or (k, n) of k trainings, whose mean scores are compared then. The interval is a
    bootstrap over the groups (scenario seeds), each drawn with all its windows: windows of one traffic are not
    independent. It does not cover what another training would change; `spread` tells that.
    """
    names, of_window = np.unique(groups.astype(str), return_inverse=True)
    g = len(names)
    weights = np.concatenate([np.ones((1, g)), stream("bootstrap", g).multinomial(g, np.full(g, 1 / g), draws)])
    macro, each = np.zeros(draws + 1), np.zeros((draws + 1, len(classes)))
    for sign, predicted in ((1, first), (-1, second)):
        counts = _grouped(label, np.atleast_2d(predicted), of_window, g, len(classes))
        drawn = np.einsum("dg,kgij->dkij", weights, counts)
        macro += sign * macro_f1(drawn).mean(axis=1)
        each += sign * f1_scores(drawn).mean(axis=1)
    return {
        "groups": g,
        "macro_f1": _interval(macro),
        "per_class_f1": {name: _interval(each[:, k]) for k, name in enumerate(classes)},
    }


def spread(values: Sequence[float | None]) -> dict[str, Any]:
    """`mean`, `sd` (of one more draw, n - 1) and `n` of a score over trainings; those without one are left out."""
    found = np.array([v for v in values if v is not None], dtype=np.float64)
    return {
        "mean": number(found.mean()) if len(found) else None,
        "sd": number(found.std(ddof=1)) if len(found) > 1 else None,
        "n": len(found),
    }


def _grouped(label: IntArray, predicted: IntArray, of_window: IntArray, n_groups: int, n_classes: int) -> Array:
    """Confusion matrices (k, groups, G, G) of answers (k, n)."""
    counts = np.zeros((len(predicted), n_groups, n_classes, n_classes))
    for k, said in enumerate(predicted):
        np.add.at(counts[k], (of_window, label, said), 1)
    return counts


def number(value: Any) -> float | None:
    """A plain float for JSON, None for NaN."""
    return float(value) if np.isfinite(value) else None


def _interval(difference: Array) -> dict[str, float | None]:
    """The difference itself, which comes first, and the interval of its draws."""
    drawn = difference[1:][np.isfinite(difference[1:])]
    low, high = np.quantile(drawn, [0.025, 0.975]) if len(drawn) else (np.nan, np.nan)
    return {"difference": number(difference[0]), "low": number(low), "high": number(high)}
