"""The same predictor trained with several seeds: mean and spread of its scores, and comparisons of such groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.evaluation import metrics
from models.evaluation.predictions import Answers
from models.run import Run

SCORES = ("accuracy", "macro_f1", "auroc_unknown")


@dataclass(frozen=True)
class Measured:
    """A run, what it said about the windows that all of a comparison share, and its metrics."""

    run: Run
    given: Answers
    found: dict[str, Any]


def same_but_for_seed(first: Run, second: Run) -> bool:
    """Whether two runs are one predictor, trained with two seeds."""
    cards = [run.card.settings.model_copy(update={"seed": 0}) for run in (first, second)]
    return cards[0] == cards[1] and first.card.dataset.get("digest") == second.card.dataset.get("digest")


def grouped(everyone: Sequence[Measured]) -> list[list[Measured]]:
    """Runs that differ in the training seed alone, together; groups in the order of their first run."""
    groups: list[list[Measured]] = []
    for each in everyone:
        group = next((g for g in groups if same_but_for_seed(g[0].run, each.run)), None)
        if group is None:
            groups.append([each])
        else:
            group.append(each)
    return groups


def over_training_seeds(everyone: Sequence[Measured]) -> list[dict[str, Any]]:
    """Mean and spread of each group's scores, and its paired difference to the first group.

    The difference is of mean scores, first group minus this one, with an interval over scenario seeds; `sd` of the
    scores tells how much of it another training could change.
    """
    groups = grouped(everyone)
    first, rows = groups[0], []
    for group in groups:
        row = summary([each.found for each in group])
        row = {"name": group[0].run.name, "training_seeds": [each.run.card.settings.seed for each in group], **row}
        if group is not first:
            row["paired_difference"] = difference(first, group)
        rows.append(row)
    return rows


def summary(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """`mean`, `sd` and `n` of scores over several contents of metrics.json of one predictor.

    Of `accuracy`, `macro_f1`, `auroc_unknown`, `per_class_f1`, and the pair `overtake_against_left`.
    """
    pair = "overtake_against_left"
    return {
        **{name: metrics.spread([each[name] for each in found]) for name in SCORES},
        "per_class_f1": {
            name: metrics.spread([each["per_class_f1"][name] for each in found]) for name in found[0]["classes"]
        },
        pair: {name: metrics.spread([each[pair][name] for each in found]) for name in ("accuracy", "auroc")},
    }


def difference(first: Sequence[Measured], second: Sequence[Measured]) -> dict[str, Any]:
    """`metrics.paired_difference` of two groups, on the windows whose intention all of them were trained on."""
    given = first[0].given
    known = np.all([each.given.known for each in (*first, *second)], axis=0)
    said = [np.stack([each.given.predicted[known] for each in group]) for group in (first, second)]
    return metrics.paired_difference(
        given.label[known], said[0], said[1], given.group[known], first[0].run.card.classes
    )
