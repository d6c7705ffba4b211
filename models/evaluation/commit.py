"""Prediction and recognition apart: scores of windows that end before the commit, and of those that end after it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from labeling.intentions import Intention
from models.evaluation import metrics
from models.evaluation.metrics import BoolArray
from models.evaluation.predictions import Predictions
from models.evaluation.score_results import (
    AfterCommit,
    BeforeCommit,
    ClassifiedWindows,
    CommitDelay,
    FiveClassScores,
    LeadScores,
)

AT_ONCE_S = 0.3
"""An intention whose median record commits sooner than this after its onset can be recognised, but hardly predicted."""
JOINT = "left_lane_change_or_overtake"
"""Name of the class that the five-class scores make of left lane change and overtake."""


def before_commit(
    predictions: Predictions, at_leads: Mapping[float, Predictions], classes: tuple[str, ...]
) -> BeforeCommit:
    """Return the scores of the windows that end before the commit.

    predictions: on the windows of the evaluation. at_leads: on windows that end at a fixed time before the commit, by
    that time, s. classes: names of the known intentions.
    """
    rows = predictions.before_commit
    counts = metrics.confusion(predictions.label[rows], predictions.predicted[rows], len(classes))
    return BeforeCommit(
        **dict(_of_rows(predictions, rows, classes)),
        confusion=counts.tolist(),
        by_lead=[
            LeadScores(
                **dict(_of_rows(at_lead, at_lead.known, classes)),
                lead_s=lead_s,
                by_origin=_by_origin(at_lead, at_lead.known, classes),
            )
            for lead_s, at_lead in at_leads.items()
        ],
        by_origin=_by_origin(predictions, rows, classes),
        onset_to_commit=commit_delays(predictions, classes),
    )


def after_commit(predictions: Predictions, classes: tuple[str, ...]) -> AfterCommit:
    """Return the scores of the windows that end at or after the commit; classes: names of the known intentions."""
    rows = predictions.after_commit
    counts = metrics.confusion(predictions.label[rows], predictions.predicted[rows], len(classes))
    return AfterCommit(**dict(_of_rows(predictions, rows, classes)), confusion=counts.tolist())


def commit_delays(predictions: Predictions, classes: tuple[str, ...]) -> dict[str, CommitDelay]:
    """Return the time from onset to commit of the measured records of each known intention, by its name."""
    _, first = np.unique(predictions.sample_id.astype(str), return_index=True)
    delay_s, label = (predictions.after_onset_s + predictions.lead_s)[first], predictions.label[first]
    delays = {}
    for k, name in enumerate(classes):
        of_class = delay_s[(label == k) & predictions.known[first]]
        median_s = float(np.median(of_class)) if len(of_class) else None
        delays[name] = CommitDelay(
            n=len(of_class), median_s=median_s, at_once=median_s is not None and median_s < AT_ONCE_S
        )
    return delays


def five_classes(predictions: Predictions, classes: tuple[str, ...]) -> FiveClassScores:
    """Return the scores with overtake and left lane change as one intention; classes: names of the known intentions."""
    left, overtake = int(Intention.LEFT_LANE_CHANGE), int(Intention.OVERTAKE)
    names = tuple(JOINT if k == left else name for k, name in enumerate(classes) if k != overtake)
    # Number of each of the six classes among the five.
    number = np.array([k - (k > overtake) for k in range(len(classes))])
    number[overtake] = number[left]
    label, predicted = number[np.where(predictions.known, predictions.label, 0)], number[predictions.predicted]
    known, early = predictions.known, predictions.before_commit
    summary = metrics.summary(label[known], predicted[known], names)
    scores = metrics.classified(label[early], predicted[early], predictions.group[early], names)
    return FiveClassScores(
        classes=list(names), **summary.model_dump(exclude={"confusion"}), before_commit_macro_f1=scores.macro_f1
    )


def _of_rows(predictions: Predictions, rows: BoolArray, classes: tuple[str, ...]) -> ClassifiedWindows:
    """Return the scores of some windows, a mask (n,)."""
    return metrics.classified(predictions.label[rows], predictions.predicted[rows], predictions.group[rows], classes)


def _by_origin(predictions: Predictions, rows: BoolArray, classes: tuple[str, ...]) -> dict[str, ClassifiedWindows]:
    """Return the scores of some windows, a mask (n,), by the origin of the maneuver."""
    origins = sorted(set(predictions.origin[rows].astype(str)))
    return {name: _of_rows(predictions, rows & (predictions.origin == name), classes) for name in origins}
