"""The networks of a stage, as the page reads them: confusion matrices by horizon and fold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from isac_cosim.evaluation.statistics import Trainings, pooled
from isac_cosim.studies.reproduction.castformer.results import VariantsResult
from isac_cosim.studies.reproduction.experiments.stages import result_of
from isac_cosim.studies.reproduction.experiments.trainings import Scores, of_measure


@dataclass(frozen=True)
class MeasuredVariant:
    """A network that was measured on every fold.

    name, title: as in `Variant`. scores: of the folds. background: the class that is no maneuver, if there is one.
    repeats: scores of the folds in further trainings.
    """

    name: str
    title: str
    scores: Sequence[Scores]
    background: int | None = None
    repeats: Sequence[Sequence[Scores]] = ()

    def at(self, horizon_s: int) -> Trainings:
        """Return the confusion matrices at a horizon, by fold, for every training of the folds.

        The fold is the unit of the intervals: it has a training of its own, so they cover trainings, too.
        """
        by_training = [of_measure(scores, str(horizon_s)) for scores in (self.scores, *self.repeats)]
        return [{f"fold {k}": pooled([fold]).tolist() for k, fold in enumerate(folds) if fold} for folds in by_training]


def measured_of(out: Path, stage: str) -> list[MeasuredVariant]:
    """Return the networks that a stage measured, none where it was not run."""
    result = result_of(out, stage, VariantsResult)
    if result is None:
        return []
    return [MeasuredVariant(row.name, row.title, row.folds, result.background) for row in result.variants]


def with_repeats(
    measured: Sequence[MeasuredVariant], repeats: Sequence[Sequence[MeasuredVariant]]
) -> list[MeasuredVariant]:
    """Return networks with what further trainings measured of those that were trained again."""
    return [
        replace(row, repeats=[again.scores for repeat in repeats for again in repeat if again.name == row.name])
        for row in measured
    ]
