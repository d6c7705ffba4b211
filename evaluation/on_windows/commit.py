"""Prediction and recognition apart: scores of windows that end before the commit, and of those that end after it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.metrics import BoolArray
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.on_windows.score_results import (
    AfterCommit,
    BeforeCommit,
    ClassifiedWindows,
    CommitDelay,
    FiveClassScores,
    HeldOutScores,
    LeadScores,
    PairScores,
    Separation,
)
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.scores import open_set

AT_ONCE_S = 0.3
"""An intention whose median record commits sooner than this after its onset can be recognised, but hardly predicted."""


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
    """Return the scores with overtake and the lane change that it begins with as one intention.

    classes: names of the known intentions.
    """
    changes = lane_change_names(predictions)
    out, overtake = int(Intention.LEFT_LANE_CHANGE), int(Intention.OVERTAKE)
    named = {**dict(enumerate(classes)), out: f"{changes[0]}_or_overtake", int(Intention.RIGHT_LANE_CHANGE): changes[1]}
    names = tuple(name for k, name in named.items() if k != overtake)
    # Number of each of the six classes among the five.
    number = np.array([k - (k > overtake) for k in range(len(classes))])
    number[overtake] = number[out]
    known, early, by_side = predictions.known, predictions.before_commit, predictions.by_faster_side
    label, predicted = number[np.where(known, by_side.label, 0)], number[by_side.predicted]
    summary = metrics.summary(label[known], predicted[known], names)
    scores = metrics.classified(label[early], predicted[early], predictions.group[early], names)
    return FiveClassScores(
        classes=list(names),
        **summary.model_dump(exclude={"confusion"}),
        before_commit_macro_f1=scores.macro_f1,
        before_commit_macro_f1_over=scores.macro_f1_over,
    )


def overtake_or_change(predictions: Predictions, classes: tuple[str, ...]) -> PairScores:
    """Return how well an overtake is distinguished from a lane change to the same side, on windows of these two only.

    classes: names of the known intentions.
    """
    known, by_side = predictions.known, predictions.by_faster_side
    pair = (int(Intention.LEFT_LANE_CHANGE), int(Intention.OVERTAKE))
    scores = metrics.pair_confusion(by_side.outputs.logits[known], by_side.label[known], classes, pair)
    return scores.model_copy(update={"intentions": [lane_change_names(predictions)[0], classes[pair[1]]]})


def lane_change_names(predictions: Predictions) -> tuple[str, str]:
    """Return the names of the lane change to the faster side and of the other one.

    They are named by their direction in the plane, but where traffic keeps left in some scenarios only.
    """
    left, right = Intention.LEFT_LANE_CHANGE.text, Intention.RIGHT_LANE_CHANGE.text
    sides = {bool(keeps_left) for keeps_left in np.unique(predictions.keeps_left)}
    if sides == {True, False}:
        return "lane_change_to_faster_side", "lane_change_to_slower_side"
    return (right, left) if sides == {True} else (left, right)


def _of_rows(predictions: Predictions, rows: BoolArray, classes: tuple[str, ...]) -> ClassifiedWindows:
    """Return the scores of some windows, a mask (n,)."""
    return metrics.classified(predictions.label[rows], predictions.predicted[rows], predictions.group[rows], classes)


def _by_origin(predictions: Predictions, rows: BoolArray, classes: tuple[str, ...]) -> dict[str, ClassifiedWindows]:
    """Return the scores of some windows, a mask (n,), by the origin of the maneuver."""
    origins = sorted(set(predictions.origin[rows].astype(str)))
    return {name: _of_rows(predictions, rows & (predictions.origin == name), classes) for name in origins}


def separation(known: Array, unknown: Array) -> Separation:
    """Return how well a score separates known windows, values (n,), from unknown ones, values (m,)."""
    return Separation(auroc=open_set.auroc(known, unknown), fpr_at_95_recall=open_set.accepted_unknown(known, unknown))


def separation_of_rows(known: Array, unknown: Array) -> Callable[[BoolArray], Separation]:
    """Return `separation` as a function of some of the known windows, a mask (n,), against all unknown ones.

    `following` does not commit and has no lead time, so every bin of the known is compared with all of it.
    """
    return lambda rows: separation(known[rows], unknown)


def following_scores(predictions: Predictions, values: Mapping[str, Array]) -> dict[str, Separation]:
    """Return how well each score separates `following`; values: of every score, (n,), by its name."""
    return {name: separation(value[predictions.known], value[predictions.unknown]) for name, value in values.items()}


def held_out_scores(predictions: Predictions, values: Mapping[str, Array]) -> HeldOutScores | None:
    """Return how well each score separates the intention left out of training, or None where none was.

    values: of every score, (n,), by its name.
    """
    if predictions.left_out is None:
        return None
    return HeldOutScores(
        intention=predictions.left_out.text,
        n=int(predictions.held_out.sum()),
        unknown_scores={
            name: separation(value[predictions.known], value[predictions.held_out]) for name, value in values.items()
        },
    )
