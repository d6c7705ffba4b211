"""A whole study: the dataset, the predictor and its evaluation, or a sweep of them, read from one TOML file."""

from __future__ import annotations

import importlib.resources
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from command_line.arguments import channel
from isacsim.sensing import SensingSettings
from isacsim.settings import Settings, checked, read_toml
from labeling.generation.settings import DatasetStudy
from models.evaluation.evaluation import EvaluateSettings
from models.run import Model, TrainSettings
from models.studies.sweep_axes import Cell, Sensing, SweepAxes, network_name, sensings

QUICK = "quick.toml"
"""The bundled study that runs when none is named."""
FLOOR: Model = "trees"
"""The plain predictor that every other is compared with."""


class Study(Settings):
    """Everything between scenarios and results.

    name: of the folder of results where none is given; the file's name when absent. sweep: what is varied; a study
    without it is a single cell, beside its floor.
    """

    name: str = Field("", pattern=r"^[A-Za-z0-9_-]*$")
    dataset: DatasetStudy = DatasetStudy()
    training: TrainSettings = TrainSettings()
    evaluation: EvaluateSettings = EvaluateSettings()
    sweep: SweepAxes | None = None

    @model_validator(mode="after")
    def _can_be_sensed_anew(self) -> Self:
        if self.sweep is not None and len(self.sweep.snr) > 1 and self.dataset.sensing.channel.blockage:
            raise ValueError(
                "sweep.snr: with more than one, records are sensed anew, and blockage asks for the other vehicles, "
                "which records do not hold; give one, or take dataset.sensing.channel.blockage out"
            )
        return self

    @property
    def floor(self) -> TrainSettings:
        """The plain predictor to compare with: boosted trees on the same windows and split."""
        return self.training.model_copy(update={"model": FLOOR})

    @property
    def axes(self) -> SweepAxes:
        """What is varied, the floor first among the models, and the study's own values on axes that are left out."""
        axes = self.sweep or SweepAxes()
        models = tuple(dict.fromkeys([FLOOR, *(axes.models or (self.training.model,))]))
        return axes.model_copy(
            update={"models": models, "training_seeds": axes.training_seeds or (self.training.seed,)}
        )

    @property
    def networks(self) -> dict[str, DatasetStudy]:
        """The dataset that is generated of each network, by its short name.

        Without scenarios in the sweep the study's own make one network together.
        """
        axes, own = self.axes, self.dataset.model_copy(update={"sensing": self.sensing_at(self.first.snr)})
        if not axes.scenarios:
            return {"+".join(map(network_name, own.scenarios)): own}
        return {network_name(where): own.model_copy(update={"scenarios": (where,)}) for where in axes.scenarios}

    @property
    def first(self) -> Sensing:
        """The way of sensing that datasets are generated with, by the sites; other ways sense their records anew."""
        return next((each for each in sensings(self.axes) if each.sensor == "isac"), Sensing("isac"))

    @property
    def cells(self) -> list[Cell]:
        """Every network, way of sensing and predictor of the sweep."""
        axes = self.axes
        return [
            Cell(network, sensing, model)
            for network in self.networks
            for sensing in sensings(axes)
            for model in axes.models
        ]

    def sensing_at(self, snr: str | None) -> SensingSettings:
        """The study's own sensing at another SNR, as `cosim sense --snr` takes it, None for its own."""
        own = self.dataset.sensing
        if snr is None:
            return own
        content = own.model_dump()
        return SensingSettings.model_validate({**content, "channel": {**content["channel"], **channel(snr)}})

    def training_of(self, model: Model, seed: int) -> TrainSettings:
        """The study's own training settings for another predictor and training seed."""
        return self.training.model_copy(update={"model": model, "seed": seed})


def read_study(path: Path | None) -> Study:
    """A study from its file, or the bundled quick one. Raises InputError naming the key that is wrong."""
    file = Path(str(importlib.resources.files("studies") / QUICK)) if path is None else path
    study = checked(Study, read_toml(file), file)
    return study if study.name else study.model_copy(update={"name": file.stem.strip(".") or "study"})
