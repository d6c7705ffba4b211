"""What the files of this paper's stages hold."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.studies.reproduction.experiments.stage_results import Count, DatasetFacts, StageResult
from isac_cosim.studies.reproduction.experiments.trainings import Scores


class DatasetResult(StageResult):
    """The generated dataset. sides: scenario seeds of each side. samples: `known` and `following` of each side."""

    datasets: dict[str, DatasetFacts]
    sides: dict[str, list[str]]
    samples: dict[str, dict[str, Count]]

    @model_validator(mode="after")
    def _of_the_same_sides(self) -> Self:
        if missing := self.samples.keys() - self.sides.keys():
            raise ValueError(f"sides: {min(missing)} is missing")
        return self


class TrainingsResult(StageResult):
    """Scores of trainings.

    dataset: that they are tested on; datasets: those, by measure, where there are several. snr_db: test SNRs of Fig. 5,
    dB. epochs: of each training, where the stage sets them.
    """

    trainings: Annotated[list[Scores], Field(min_length=1)]
    dataset: DatasetFacts | None = None
    datasets: dict[str, DatasetFacts] = Field(default_factory=dict)
    snr_db: list[Annotated[float, Field(ge=-200, le=200)]] = Field(default_factory=list)
    epochs: int | None = Field(None, ge=1)

    @model_validator(mode="after")
    def _of_the_known_intentions(self) -> Self:
        unknown = [scores.unknown for scores in self.trainings if scores.unknown is not None]
        if {scores.classes for scores in self.trainings} - {None, len(KNOWN)}:
            raise ValueError(f"trainings: their confusion matrices are not of {len(KNOWN)} intentions")
        if any(len(scores.confusion) != len(KNOWN) + 1 for scores in unknown):
            raise ValueError(f"trainings: unknown.confusion: is not of {len(KNOWN)} intentions and the unknown class")
        if len({(*sorted(scores.roc), *map(str, scores.seeds_by_score.items())) for scores in unknown}) > 1:
            raise ValueError("trainings: unknown: has not the same scores and seeds in every training")
        return self
