"""Which record of the unseen seeds the report draws: a typical one by a stated rule, not the best one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isacsim.arrays import IntArray
from labeling.intentions import KNOWN, Intention
from models.evaluation.predictions import Predictions

PREFERRED = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.OVERTAKE, Intention.EVASIVE_SWERVE)
"""Intentions that are seen best from above, in the order in which they are tried."""


@dataclass(frozen=True)
class RecordChoice:
    """A record to draw, by its sample_id, and a sentence that says how it was chosen."""

    sample_id: str
    rule: str


def choose_record(predictions: Predictions) -> RecordChoice:
    """Choose a typical record among those that were measured.

    Of the records of one intention that were recognised at their last measured window, it is the one with the median
    probability of that intention there; of an even number the less confident of the middle two. The intention is the
    first of PREFERRED, then of the others, of which any record was recognised.
    """
    last = _last_windows(predictions)
    known = last[predictions.known[last]]
    if not len(known):
        return RecordChoice(
            str(predictions.sample_id[0]), "It is the first test record; none is of an intention that was trained."
        )
    label = predictions.label[known]
    recognised = predictions.predicted[known] == label
    for intention in dict.fromkeys((*PREFERRED, *KNOWN)):
        of_intention = label == intention
        if (of_intention & recognised).any():
            name = intention.text.replace("_", " ")
            rule = (
                f"Of {of_intention.sum()} test records of {name}, {(of_intention & recognised).sum()} were recognised "
                f"at their last measured window; this is the one of them with the median probability of {name} there."
            )
            return RecordChoice(_median_record(predictions, known[of_intention & recognised]), rule)
    rule = (
        f"None of the {len(known)} test records was recognised at its last measured window; this is the one with the "
        "median probability of its true intention there."
    )
    return RecordChoice(_median_record(predictions, known), rule)


def _last_windows(predictions: Predictions) -> IntArray:
    """Return the row of the window that ends last, of each record, in the order of the records."""
    last: dict[str, int] = {}
    for row, sample_id in enumerate(predictions.sample_id):
        if sample_id not in last or predictions.end_s[row] > predictions.end_s[last[sample_id]]:
            last[sample_id] = row
    return np.array(list(last.values()), dtype=np.int64)


def _median_record(predictions: Predictions, rows: IntArray) -> str:
    """Return the sample_id of the row, among some, with the (lower) median probability of its true intention."""
    probability = predictions.outputs.probabilities[rows, predictions.label[rows]]
    order = np.argsort(probability, kind="stable")
    return str(predictions.sample_id[rows[order[(len(rows) - 1) // 2]]])
