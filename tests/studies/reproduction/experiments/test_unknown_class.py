"""The figures of the unknown class, against scikit-learn on the same predictions."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from isac_cosim.studies.reproduction.experiments.trainings import Measure, counts_by_group, predictions_of
from isac_cosim.studies.reproduction.experiments.unknown_class import RATES, UnknownScores, unknown_scores

MEASURE = Measure(name="test", dataset=".")


@pytest.fixture(scope="module")
def sides(records: Records, network_run: Run) -> tuple[Predictions, Predictions]:
    """Predictions on the test seeds and on the validation seeds."""
    of_side = (records.take(np.isin(records.groups, network_run.card.split[side])) for side in ("test", "validation"))
    test, validation = (predictions_of(network_run, side, MEASURE) for side in of_side)
    return test, validation


@pytest.fixture(scope="module")
def measured(network_run: Run, sides: tuple[Predictions, Predictions]) -> UnknownScores:
    scores = unknown_scores(network_run, *sides)
    assert scores is not None
    return scores


def test_areas_and_curves_agree(measured: UnknownScores, sides: tuple[Predictions, Predictions]) -> None:
    predictions = sides[0]
    confidence = predictions.outputs.probabilities.max(axis=1)
    used = predictions.known | predictions.unknown
    assert measured.auroc["msp"] == pytest.approx(roc_auc_score(predictions.known[used], confidence[used]))
    for name, rates in measured.roc.items():
        area = np.trapezoid(rates, np.linspace(0, 1, RATES))
        assert area == pytest.approx(measured.auroc[name], abs=0.03)
        assert rates[-1] == 1.0
        assert rates == sorted(rates)


def test_areas_without_each_seed(measured: UnknownScores, sides: tuple[Predictions, Predictions]) -> None:
    predictions = sides[0]
    confidence = predictions.outputs.probabilities.max(axis=1)
    groups = sorted(set(predictions.group))
    assert set(measured.auroc_without) == set(measured.auroc)
    for group, area in zip(groups, measured.auroc_without["msp"], strict=True):
        used = (predictions.known | predictions.unknown) & (predictions.group != group)
        assert area == pytest.approx(roc_auc_score(predictions.known[used], confidence[used]))


def test_the_last_row_and_column_are_the_unknown(
    measured: UnknownScores, sides: tuple[Predictions, Predictions]
) -> None:
    predictions, validation = sides
    confidence = predictions.outputs.probabilities.max(axis=1)
    counts = np.array(measured.confusion)
    assert counts.shape == (7, 7)
    assert counts[6].sum() == measured.n_unknown == predictions.unknown.sum()
    assert counts[:, 6].sum() == (confidence < measured.threshold)[predictions.known | predictions.unknown].sum()
    assert (
        counts[2, 2]
        == ((predictions.label == 2) & (predictions.predicted == 2) & (confidence >= measured.threshold)).sum()
    )
    kept = validation.outputs.probabilities.max(axis=1)[validation.known] >= measured.threshold
    assert 0 <= 0.05 * len(kept) - (~kept).sum() + 1 <= 2


def test_histograms_count_every_window(measured: UnknownScores) -> None:
    assert sum(measured.known_confidence) == measured.n_known
    assert sum(measured.unknown_confidence) == measured.n_unknown


def test_counts_by_group_add_up(sides: tuple[Predictions, Predictions]) -> None:
    predictions = sides[0]
    counts = counts_by_group(predictions, 6)
    assert set(counts) == set(predictions.group)
    total = np.sum(list(counts.values()), axis=0)
    assert total.sum() == predictions.known.sum()
    assert np.trace(total) == (predictions.predicted == predictions.label)[predictions.known].sum()
