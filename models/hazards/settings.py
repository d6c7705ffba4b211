"""The settings of a training on streams: what is asked, which decisions are taken, and what the predictor sees."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from isac_cosim.base.settings import Settings
from isac_cosim.models.trees.boosting import BoostingSettings

Horizon = Annotated[float, Field(gt=0, le=60)]


class HazardTreesSettings(BoostingSettings):
    """Settings of the trees, one set of trees an intention."""

    rounds: int = Field(200, ge=1, le=100_000, description="boosting rounds")
    learning_rate: float = Field(0.06, gt=0, le=1e3, description="shrinkage of each boosting round")
    leaves: int = Field(31, ge=2, le=1_000_000, description="leaves per tree")
    l2: float = Field(5.0, ge=0, le=1e9, description="L2 regularisation of leaf values")
    least_leaf: int = Field(80, ge=1, le=1_000_000, description="fewest training rows in a leaf")
    feature_share: float = Field(0.4, gt=0, le=1, description="share of the features that each split may choose from")


class MixturesSettings(Settings):
    """Settings of the naive Bayes classifier with Gaussian mixtures."""

    most_components: int = Field(5, ge=1, le=50, description="most normal distributions in a mixture")
    most_decisions: int = Field(
        20_000,
        ge=100,
        le=10_000_000,
        description="most decisions that a mixture is fitted to; of more, so many are drawn",
    )


class CausalSettings(Settings):
    """Settings of the causal network."""

    width: int = Field(64, ge=1, le=4096, description="width of its layers")
    dropout: float = Field(0.1, ge=0, lt=1, description="share of values dropped in training")
    sequence: int = Field(64, ge=1, le=100_000, description="decisions in a training sequence")


class StreamFitSettings(Settings):
    """What a predictor is asked on streams, and what it is trained on.

    The question is a hazard in discrete time: whether an intention begins within the first horizon, and if not, within
    the next one, and so on. From onset to commit it counts as begun.
    """

    horizons_s: tuple[Horizon, ...] = Field(
        (0.5, 1.0, 2.0), min_length=1, max_length=20, description="ends of the intervals before onset, s, rising"
    )
    every_s: float = Field(0.2, gt=0, le=60, description="time between two decisions that may be trained on, s")
    hard_share: float = Field(
        1 / 3, gt=0, le=1, description="share of the hard negatives that are trained on, with the weight of all"
    )
    easy_share: float = Field(
        0.1, gt=0, le=1, description="share of the other negatives that are trained on, with the weight of all"
    )
    hard_across_mps: float = Field(
        0.25, ge=0, le=1e3, description="a negative is hard if the TV moves faster across its lane than this, m/s"
    )
    hard_acceleration_mps2: float = Field(
        1.2, ge=0, le=1e3, description="a negative is hard if the TV accelerates or brakes more than this, m/s2"
    )
    least_events: int = Field(
        10, ge=1, le=1_000_000, description="an intention with fewer training events is not learned, and never named"
    )
    uv: bool = Field(True, description="whether the predictor sees the UV's reports")
    lanes: bool = Field(True, description="whether the predictor sees the lanes of the road network")
    truth: bool = Field(False, description="whether it is trained on the TVs' true motion in place of the sensed one")
    trees: HazardTreesSettings = HazardTreesSettings()
    mixtures: MixturesSettings = MixturesSettings()
    causal: CausalSettings = CausalSettings()

    @model_validator(mode="after")
    def _horizons_rise(self) -> Self:
        if list(self.horizons_s) != sorted(set(self.horizons_s)):
            raise ValueError(f"horizons_s {self.horizons_s}: give each once, the nearest first")
        return self
