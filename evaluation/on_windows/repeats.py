"""One predictor trained with several seeds: mean and spread of its scores, and comparisons of such groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.on_windows.results import PredictorResult, RunResult
from isac_cosim.evaluation.on_windows.score_results import LeadDifference, PairedDifference, PairSpreads, ScoreSpreads
from isac_cosim.models.runs.run import Run


@dataclass(frozen=True)
class MeasuredRun:
    """A run, its predictions on the windows that all runs of a comparison share, and its metrics.

    at_leads: predictions on windows that end at a fixed time before the commit, by that time, s.
    at_ends: predictions of the window-end curve, by the end of the windows, s.
    dropped: predictions on windows of pull-outs that are in no class; None where the dataset has none.
    """

    run: Run
    predictions: Predictions
    result: RunResult
    at_leads: Mapping[float, Predictions] = field(default_factory=dict)
    at_ends: Mapping[float, Predictions] = field(default_factory=dict)
    dropped: Predictions | None = None


def same_but_for_seed(first: Run, second: Run) -> bool:
    """Return whether two runs are the same predictor, trained on the same dataset with two seeds."""
    settings = [run.card.settings for run in (first, second)]
    cards = [of_run.model_copy(update={"seed": 0}) for of_run in settings]
    differ = settings[0].seed != settings[1].seed
    return differ and cards[0] == cards[1] and first.card.dataset.get("digest") == second.card.dataset.get("digest")


def grouped(measured: Sequence[MeasuredRun]) -> list[list[MeasuredRun]]:
    """Group runs that differ in the training seed alone; groups are in the order of their first run."""
    groups: list[list[MeasuredRun]] = []
    for candidate in measured:
        repeats = (group for group in groups if all(same_but_for_seed(one.run, candidate.run) for one in group))
        group = next(repeats, None)
        if group is None:
            groups.append([candidate])
        else:
            group.append(candidate)
    return groups


def over_training_seeds(measured: Sequence[MeasuredRun]) -> list[PredictorResult]:
    """Return mean and spread of each group's scores, and its paired difference to the first group.

    The difference is of mean scores, first group minus this one, with an interval over scenario seeds. The standard
    deviation of the scores shows how much another training could change.
    """
    groups = grouped(measured)
    first = groups[0]
    return [
        PredictorResult(
            name=group[0].run.name,
            training_seeds=[member.run.card.settings.seed for member in group],
            **dict(spreads([member.result for member in group])),
            paired_difference=None if group is first else difference(first, group),
            paired_difference_before_commit=None if group is first else difference_before_commit(first, group),
            paired_difference_by_lead=None if group is first else differences_by_lead(first, group),
        )
        for group in groups
    ]


def spreads(results: Sequence[RunResult]) -> ScoreSpreads:
    """Return mean and spread of the scores of several runs of one predictor."""
    pairs = [result.overtake_against_left for result in results]
    return ScoreSpreads(
        accuracy=metrics.spread([result.accuracy for result in results]),
        macro_f1=metrics.spread([result.macro_f1 for result in results]),
        before_commit_macro_f1=metrics.spread([result.before_commit_macro_f1 for result in results]),
        auroc_unknown=metrics.spread([result.auroc_unknown for result in results]),
        per_class_f1={
            name: metrics.spread([result.per_class_f1[name] for result in results]) for name in results[0].classes
        },
        overtake_against_left=PairSpreads(
            accuracy=metrics.spread([pair.accuracy for pair in pairs]),
            auroc=metrics.spread([pair.auroc for pair in pairs]),
        ),
    )


def difference(first: Sequence[MeasuredRun], second: Sequence[MeasuredRun]) -> PairedDifference:
    """Return `metrics.paired_difference` of two groups, on windows of intentions that all of them were trained on."""
    return _difference(_drawn(first), _drawn(second), first[0].run.card.classes)


def difference_before_commit(first: Sequence[MeasuredRun], second: Sequence[MeasuredRun]) -> PairedDifference:
    """Return the same on the windows that end before the commit."""
    before_commit = first[0].predictions.before_commit
    return _difference(
        _drawn(first), _drawn(second), first[0].run.card.classes, before_commit, least=metrics.LEAST_IN_BIN
    )


def differences_by_lead(first: Sequence[MeasuredRun], second: Sequence[MeasuredRun]) -> list[LeadDifference]:
    """Return the same on the windows that end at each fixed time before the commit."""
    differences = []
    for lead_s in first[0].at_leads:
        one, other = ([member.at_leads[lead_s] for member in group] for group in (first, second))
        paired = _difference(one, other, first[0].run.card.classes, least=metrics.LEAST_IN_BIN)
        differences.append(LeadDifference(lead_s=lead_s, **dict(paired)))
    return differences


def _drawn(group: Sequence[MeasuredRun]) -> list[Predictions]:
    """Return each run's predictions on the windows of the evaluation."""
    return [member.predictions for member in group]


def _difference(
    first: Sequence[Predictions],
    second: Sequence[Predictions],
    classes: tuple[str, ...],
    rows: metrics.BoolArray | None = None,
    least: int = 1,
) -> PairedDifference:
    """Return the paired difference between two groups of runs, from their predictions on the same windows.

    classes: names of the known intentions. rows: the windows to count, a mask (n,); all of them when absent.
    least: a class with fewer windows is left out of the macro-F1.
    """
    shared = first[0]
    known = np.all([predictions.known for predictions in (*first, *second)], axis=0)
    if rows is not None:
        known &= rows
    predicted = [np.stack([predictions.predicted[known] for predictions in group]) for group in (first, second)]
    return metrics.paired_difference(
        shared.label[known], predicted[0], predicted[1], shared.group[known], classes, least
    )
