"""Eq. (13) against scikit-learn and against counting by hand, in both readings of a missed maneuver."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import precision_score, recall_score

from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.maneuvers import (
    Misses,
    false_predictions,
    maneuver_scores,
    maneuver_statistic,
)
from tests.evaluation.on_windows.test_metrics import drawn


def test_maneuver_scores_are_macro_precision_and_recall() -> None:
    label, predicted = drawn()
    result = maneuver_scores(metrics.confusion(label, predicted, 4))
    precision = precision_score(label, predicted, average="macro")
    recall = recall_score(label, predicted, average="macro")
    assert result.precision == pytest.approx(precision)
    assert result.recall == pytest.approx(recall)
    assert result.f1 == pytest.approx(2 * precision * recall / (precision + recall))


def test_the_background_is_no_maneuver_but_its_false_predictions_count() -> None:
    label = np.array([0, 0, 0, 1, 1, 2, 2, 2])
    predicted = np.array([0, 1, 2, 1, 1, 2, 0, 1])
    result = maneuver_scores(metrics.confusion(label, predicted, 3), background=2)
    # Maneuver 0: 1 hit of 2 predicted (one of them FPP), 2 missed; maneuver 1: 2 hits of 4 predicted, none missed.
    assert result.precision == pytest.approx((1 / 2 + 2 / 4) / 2)
    assert result.recall == pytest.approx((1 / 3 + 1) / 2)


def test_maneuvers_that_are_not_there_or_never_predicted() -> None:
    counts = metrics.confusion(np.array([0, 0, 1]), np.array([0, 0, 0]), 4)
    result = maneuver_scores(counts)
    assert (result.precision, result.recall, result.f1) == (pytest.approx((2 / 3) / 2), 0.5, pytest.approx(2 / 5))
    assert maneuver_scores(np.zeros((2, 2), int)).f1 is None
    assert maneuver_scores(np.array([[0, 1], [1, 0]])).f1 == 0.0


COUNTS = np.array([[30, 3, 2, 3, 2], [12, 4, 2, 2, 0], [11, 2, 3, 2, 2], [10, 3, 2, 4, 1], [9, 2, 3, 1, 5]])
"""A confusion matrix with driving straight on as class 0."""
CLIPS = np.array([[20, 0, 0, 0, 0], [0, 4, 5, 7, 4], [0, 5, 8, 2, 5], [0, 7, 6, 2, 5], [0, 5, 6, 4, 5]])
"""Clips of which those that drive straight on are all found, and maneuvers are told apart no better than by chance."""


def eq13(counts: np.ndarray, misses: Misses) -> float:
    """F1 of Eq. (13), counted out maneuver by maneuver, with class 0 as the background."""
    precisions, recalls = [], []
    for m in range(1, len(counts)):
        tp = counts[m, m]
        fp = sum(counts[k, m] for k in range(1, len(counts)) if k != m)
        fpp = counts[0, m]
        mp = counts[m, 0] if misses == "as_background" else sum(counts[m, k] for k in range(len(counts)) if k != m)
        precisions.append(tp / (tp + fp + fpp))
        recalls.append(tp / (tp + mp))
    precision, recall = np.mean(precisions), np.mean(recalls)
    return float(2 * precision * recall / (precision + recall))


@pytest.mark.parametrize("misses", ["every", "as_background"])
def test_both_readings_of_a_missed_maneuver(misses: Misses) -> None:
    assert maneuver_statistic("f1", 0, misses)(COUNTS) == pytest.approx(eq13(COUNTS, misses))


def test_a_background_that_counts_as_a_maneuver_flatters() -> None:
    assert maneuver_statistic()(CLIPS) == pytest.approx(0.386, abs=5e-4)
    assert maneuver_statistic("f1", 0)(CLIPS) == pytest.approx(0.232, abs=5e-4)


def test_false_predictions_are_those_on_the_background() -> None:
    assert false_predictions(0)(COUNTS) == pytest.approx(10 / 40)
    assert np.isnan(false_predictions(0)(np.array([[0, 0], [1, 1]])))


def test_without_a_background_nothing_is_missed_as_such() -> None:
    with pytest.raises(ValueError, match="without a background class"):
        maneuver_scores(COUNTS, None, "as_background")


@given(st.lists(st.integers(0, 30), min_size=16, max_size=16))
def test_counting_fewer_misses_never_lowers_the_recall(numbers: list[int]) -> None:
    counts = np.array(numbers).reshape(4, 4)
    every, as_background = (maneuver_scores(counts, 0, misses) for misses in ("every", "as_background"))
    assert every.precision == as_background.precision
    assert (every.recall is None) or every.recall <= as_background.recall + 1e-12
