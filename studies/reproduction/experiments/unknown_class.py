"""How well a run separates `following`, which it was not trained on: the second figure of the ASI-BIP paper."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator
from sklearn.metrics import roc_curve

from isac_cosim.base.arrays import Array
from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.on_windows.metrics import confusion
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.statistics import Counts
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.runs.former_names import OpenSetScore
from isac_cosim.models.runs.run import Run
from isac_cosim.models.scores import open_set
from isac_cosim.studies.reproduction.experiments.stage_results import Count, is_square

RATES = 101
"""Points of a stored ROC."""
BINS = 25
"""Bins of the confidence histograms, from 0 to 1."""
Share = Annotated[float, Field(ge=0, le=1)]
Histogram = Annotated[list[Count], Field(min_length=BINS, max_length=BINS)]


class UnknownScores(Settings):
    """Separation of `following` from the known intentions.

    n_known, n_unknown: number of windows. auroc: by open-set score; `pre_onset` alone saw driving in training.
    auroc_without: the same without each of the test seeds in turn, by score; empty where a seed left out leaves nothing
    to separate, and in older files.
    roc: true-positive rates (known kept) at false-positive rates (following kept) evenly spaced from 0 to 1, by score.
    auroc_by_intention, roc_by_intention: the same of each known intention against `following`, by the largest
    probability; empty in older files.
    known_confidence, unknown_confidence: number of windows in each of the bins of the largest probability, from 0 to 1.
    threshold: confidence below which a window counts as unknown; 95 % of the known validation windows are above it.
    confusion: with that threshold; rows true and columns predicted, the last of both is the unknown class.
    confusion_by_seed: the same by test seed; empty in older files.
    """

    n_known: Count
    n_unknown: Count
    auroc: dict[OpenSetScore, Share]
    auroc_without: dict[OpenSetScore, list[Share]] = Field(default_factory=dict)
    roc: dict[OpenSetScore, Annotated[list[Share], Field(min_length=RATES, max_length=RATES)]]
    auroc_by_intention: dict[str, Share] = Field(default_factory=dict)
    roc_by_intention: dict[str, Annotated[list[Share], Field(min_length=RATES, max_length=RATES)]] = Field(
        default_factory=dict
    )
    known_confidence: Histogram
    unknown_confidence: Histogram
    threshold: float
    confusion: Counts
    confusion_by_seed: dict[str, Counts] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.auroc.keys() != self.roc.keys() or not self.auroc_without.keys() <= self.roc.keys():
            raise ValueError("auroc, auroc_without and roc: are not of the same scores")
        if self.auroc_by_intention.keys() != self.roc_by_intention.keys():
            raise ValueError("auroc_by_intention and roc_by_intention: are not of the same intentions")
        matrices = [self.confusion, *self.confusion_by_seed.values()]
        if any(not is_square(matrix) or len(matrix) != len(self.confusion) for matrix in matrices):
            raise ValueError("confusion: is no confusion matrix")
        return self

    @property
    def seeds_by_score(self) -> dict[str, int]:
        """Without how many test seeds each AUROC was measured, by score."""
        return {name: len(areas) for name, areas in sorted(self.auroc_without.items())}


def unknown_scores(run: Run, predictions: Predictions, validation: Predictions) -> UnknownScores | None:
    """Return how well a run separates `following`, or None where there is none of it.

    predictions: on windows of the test seeds. validation: on those of the validation seeds; only the known intentions
    among them set the threshold.
    """
    known, unknown = predictions.known, predictions.unknown
    if not known.any() or not unknown.any():
        return None
    scores = open_set.of_run(run)
    values = {name: score(predictions.outputs) for name, score in scores.items()}
    areas = {name: open_set.auroc(value[known], value[unknown]) for name, value in values.items()}
    confidence = values[open_set.PLAIN]
    threshold = open_set.threshold_at_recall(scores[open_set.PLAIN](validation.outputs)[validation.known])
    n_classes = len(run.card.classes)
    rows = known | unknown
    label = np.where(unknown, n_classes, predictions.label)
    predicted = np.where(confidence < threshold, n_classes, predictions.predicted)
    assert int(Intention.FOLLOWING) == n_classes
    of_intention = {name: confidence[known & (predictions.label == k)] for k, name in enumerate(run.card.classes)}
    present = {name: value for name, value in of_intention.items() if len(value)}
    return UnknownScores(
        n_known=int(known.sum()),
        n_unknown=int(unknown.sum()),
        auroc={name: area for name, area in areas.items() if area is not None},
        auroc_without={name: _without_each_seed(value, predictions) for name, value in values.items()},
        roc={name: _rates(value[known], value[unknown]) for name, value in values.items()},
        auroc_by_intention={
            name: area
            for name, value in present.items()
            if (area := open_set.auroc(value, confidence[unknown])) is not None
        },
        roc_by_intention={name: _rates(value, confidence[unknown]) for name, value in present.items()},
        known_confidence=_histogram(confidence[known]),
        unknown_confidence=_histogram(confidence[unknown]),
        threshold=threshold,
        confusion=confusion(label[rows], predicted[rows], n_classes + 1).tolist(),
        confusion_by_seed={
            str(group): confusion(label[of_seed], predicted[of_seed], n_classes + 1).tolist()
            for group in sorted(set(predictions.group))
            if (of_seed := rows & (predictions.group == group)).any()
        },
    )


def _without_each_seed(value: Array, predictions: Predictions) -> list[float]:
    """Return the AUROC without each test seed in turn, or none where one of them is undefined; value: a score, (n,)."""
    areas = []
    for group in sorted(set(predictions.group)):
        rest = predictions.group != group
        areas.append(open_set.auroc(value[rest & predictions.known], value[rest & predictions.unknown]))
    defined = [area for area in areas if area is not None]
    return defined if len(defined) == len(areas) else []


def _rates(known: Array, unknown: Array) -> list[float]:
    """Return true-positive rates at evenly spaced false-positive rates, those of `UnknownScores.roc`."""
    truth = np.repeat([1, 0], [len(known), len(unknown)])
    false_rate, true_rate, _ = roc_curve(truth, np.concatenate([known, unknown]), drop_intermediate=False)
    at = np.linspace(0, 1, RATES)
    return [round(float(rate), 4) for rate in np.interp(at, false_rate, true_rate)]


def _histogram(confidence: Array) -> list[int]:
    counts, _ = np.histogram(np.clip(confidence, 0, 1), bins=BINS, range=(0, 1))
    return [int(count) for count in counts]
