"""What the files of this paper's stages hold."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from isac_cosim.base.settings import Settings
from isac_cosim.models.data.clips import NO_BACKGROUND, View
from isac_cosim.studies.reproduction.experiments.stage_results import Count, DatasetFacts, StageResult
from isac_cosim.studies.reproduction.experiments.trainings import Scores


class SamplesResult(StageResult):
    """The dataset of a source, and the scenario seeds that each fold tests; or the clips, and how many of each class.

    source: its name. clips, by_class: None where the samples are windows; dataset: where they are clips. background:
    the class of clips that is no maneuver, NO_BACKGROUND if there is none. random: views of clips whose features are of
    networks with random weights.
    """

    source: str
    dataset: DatasetFacts | None = None
    folds: list[list[str]] = Field(default_factory=list)
    clips: Count | None = None
    by_class: list[Count] | None = None
    background: int | None = Field(None, ge=NO_BACKGROUND)
    random: list[View] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_windows_or_clips(self) -> Self:
        if (self.dataset is None) == (self.by_class is None) or (self.clips is None) != (self.by_class is None):
            raise ValueError("has to hold a dataset, or clips by class")
        if (self.background is None) != (self.by_class is None):
            raise ValueError("background: has to say which class of the clips drives straight on, or that none does")
        return self


class VariantScores(Settings):
    """A network that was measured on every fold. name, title: as in `Variant`. folds: its scores."""

    name: str
    title: str
    folds: Annotated[list[Scores], Field(min_length=1)]


class VariantsResult(StageResult):
    """The networks of a table. source: of their samples. background: the class that is no maneuver, if there is one."""

    source: str
    variants: list[VariantScores]
    background: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _of_the_same_classes(self) -> Self:
        sizes = {scores.classes for variant in self.variants for scores in variant.folds} - {None}
        if len(sizes) > 1:
            raise ValueError("variants: their confusion matrices are of different sizes")
        if len({variant.name for variant in self.variants}) < len(self.variants):
            raise ValueError("variants: two have the same name")
        return self
