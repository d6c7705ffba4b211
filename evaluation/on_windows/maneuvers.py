"""Precision, recall and F1 over maneuvers; driving straight on is the background. Source: CaSTFormer, Eq. (13)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.metrics import Counts
from isac_cosim.evaluation.on_windows.score_results import ManeuverScores
from isac_cosim.evaluation.statistics import Statistic

Misses = Literal["every", "as_background"]
"""What counts as a missed maneuver, MP. every: whatever else is predicted; as_background: driving straight on alone."""


def maneuver_scores(counts: Counts, background: int | None = None, misses: Misses = "every") -> ManeuverScores:
    """Return macro-averaged precision and recall over maneuvers, and their harmonic mean.

    counts: confusion matrix, (G, G), rows true and columns predicted. background: the class that is no maneuver, if
    there is one. Its row gives false predictions (FPP). misses: the paper's MP, "failing to detect an actual
    maneuver", can be read in two ways. With `as_background`, a maneuver taken for another one lowers the precision of
    the other one alone. A maneuver without a true sample is left out; one that is never predicted has precision 0.
    Raises ValueError for misses `as_background` without a background. Source: CaSTFormer, Eq. (13).
    """
    if background is None and misses == "as_background":
        raise ValueError("misses: without a background class, no maneuver is missed as background")
    hit = np.diagonal(counts).astype(np.float64)
    true, predicted = counts.sum(axis=1), counts.sum(axis=0)
    kept = true > 0
    if background is not None:
        kept[background] = False
    if not kept.any():
        return ManeuverScores(precision=None, recall=None, f1=None)
    detected = true if misses == "every" else hit + counts[:, background]
    precision = float(np.mean(hit[kept] / np.maximum(predicted[kept], 1)))
    recall = float(np.mean(hit[kept] / np.maximum(detected[kept], 1)))
    f1 = 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
    return ManeuverScores(precision=precision, recall=recall, f1=f1)


def maneuver_statistic(
    score: Literal["precision", "recall", "f1"] = "f1", background: int | None = None, misses: Misses = "every"
) -> Statistic:
    """Return the statistic that is one of the scores of `maneuver_scores`, NaN where that is undefined."""

    def of(counts: Array) -> float:
        value = getattr(maneuver_scores(counts, background, misses), score)
        return float("nan") if value is None else float(value)

    return of


def false_predictions(background: int) -> Statistic:
    """Return the statistic that is the share of the background that is taken for a maneuver, NaN without background."""

    def of(counts: Array) -> float:
        row = counts[background]
        return float((row.sum() - row[background]) / row.sum()) if row.sum() else float("nan")

    return of
