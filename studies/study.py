"""A study: the settings of dataset, predictor and evaluation, or of a sweep over them, read from one TOML file."""

from __future__ import annotations

import importlib.resources
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, model_validator

from isac_cosim.base.parsing import channel
from isac_cosim.base.settings import Settings, checked, merged, read_toml
from isac_cosim.base.validation import first_fault
from isac_cosim.evaluation.in_traffic.settings import SEEDS
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.sensors import DEFAULT
from isac_cosim.isacsim.traffic.sources.registry import source_class
from isac_cosim.labeling.generation.generate import describe, read_scenarios
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange
from isac_cosim.models import FLOOR
from isac_cosim.models.hazards.registry import DEFAULT as DEFAULT_ON_STREAMS
from isac_cosim.models.hazards.registry import FLOOR as FLOOR_ON_STREAMS
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.sweep_axes import Cell, SweepAxes, WayOfSensing, network_name, sensings

QUICK = "quick.toml"
"""The bundled study, which runs where none is given."""


class LiveSection(Settings):
    """How the predictor of a study of streams is evaluated live.

    seeds, development: those to measure, and on which alarms are chosen; by default as `evaluate --traffic` has them.
    stress: whether the stimulated world is measured beside natural traffic. truth: whether the predictors also answer
    the true motion of the same vehicles, which tells what sensing costs.
    """

    seeds: SeedRange = SeedRange(first=SEEDS[0], last=SEEDS[1])
    development: SeedRange | None = None
    stress: bool = False
    truth: bool = False


class Study(Settings):
    """All settings between scenarios and results.

    name: of the results folder where none is given; when absent, that of the study file.
    sweep: what is varied; a study without it is a single cell, compared with its floor.
    streams: whether it generates streams, trains on them and evaluates live, instead of all that on records. In a study
    file it is a key of the section `dataset`. live: the section of that evaluation.
    """

    name: str = Field("", pattern=r"^[A-Za-z0-9_-]*$")
    dataset: DatasetStudy = DatasetStudy()
    training: TrainSettings = TrainSettings()
    evaluation: EvaluateSettings = EvaluateSettings()
    sweep: SweepAxes | None = None
    streams: bool = False
    live: LiveSection = LiveSection()

    @model_validator(mode="before")
    @classmethod
    def _streams_of_the_dataset(cls, content: Any) -> Any:
        """Take `streams` from the section of the dataset, and then train on streams."""
        if not isinstance(content, dict) or not isinstance(content.get("dataset", {}), dict):
            return content
        dataset = dict(content.get("dataset", {}))
        content = {**content, "dataset": dataset}
        if "streams" in dataset:
            content["streams"] = dataset.pop("streams")
        training = content.get("training", {})
        if content.get("streams") is True and isinstance(training, dict):
            content["training"] = {"model": DEFAULT_ON_STREAMS, "streams": {}, **training}
        return content

    @model_validator(mode="after")
    def _streams_of_one_scenario(self) -> Self:
        if not self.streams:
            if self.training.streams is not None:
                raise ValueError(
                    "training.streams: is of trainings on streams; set dataset.streams = true, or remove it"
                )
            return self
        if self.sweep is not None:
            raise ValueError("sweep: records are swept, not streams; remove it, or dataset.streams")
        if len(self.dataset.scenarios) != 1:
            raise ValueError("dataset.scenarios: a study of streams evaluates live in one scenario; give one")
        return self

    @model_validator(mode="after")
    def _can_be_sensed_anew(self) -> Self:
        if self.sweep is not None and len(self.sweep.snr) > 1 and self.dataset.sensing.channel.blockage:
            raise ValueError(
                "sweep.snr: with more than one, records are sensed anew, but blockage needs the other vehicles, "
                "which records do not hold; give one value, or remove dataset.sensing.channel.blockage"
            )
        return self

    @model_validator(mode="after")
    def _datasets_are_sound(self) -> Self:
        for scenario in self.sweep.datasets if self.sweep is not None else ():
            try:
                self._dataset_of(scenario)
            except ValidationError as error:
                raise ValueError(f"sweep.datasets.{scenario}.{first_fault(error, DatasetStudy)}") from None
        return self

    @model_validator(mode="after")
    def _scene_among_the_sensors(self) -> Self:
        if self.sweep is not None and self.dataset.sensing.scene is not None:
            raise ValueError(
                'dataset.sensing.scene: a sweep senses records anew; remove it, and add "scene" to sweep.sensors'
            )
        return self

    def check_scenarios(self) -> None:
        """Raise InputError where a scenario is at fault, before anything is written or hours go into the others."""
        for network in self.networks.values():
            describe(network, read_scenarios(network))

    @property
    def floor(self) -> TrainSettings:
        """Training settings of the floor: a plain predictor on the same windows and split."""
        return self.training.for_predictor(FLOOR)

    @property
    def stream_floor(self) -> TrainSettings | None:
        """Training settings of what a study of streams is compared with; None where the predictor is that itself."""
        if self.training.model == FLOOR_ON_STREAMS:
            return None
        content = self.training.model_dump()
        return TrainSettings.model_validate({**content, "model": FLOOR_ON_STREAMS, "optimiser": {}})

    @property
    def axes(self) -> SweepAxes:
        """What is varied, with the floor first among the models and the study's own values on absent axes."""
        axes = self.sweep or SweepAxes()
        models = tuple(dict.fromkeys([FLOOR, *(axes.models or (self.training.model,))]))
        return axes.model_copy(
            update={"models": models, "training_seeds": axes.training_seeds or (self.training.seed,)}
        )

    @property
    def networks(self) -> dict[str, DatasetStudy]:
        """Settings of the dataset that is generated for each network, by the network's short name.

        Without scenarios in the sweep, the study's own together are one network.
        """
        axes = self.axes
        if not axes.scenarios:
            dataset = self.dataset.model_copy(update={"sensing": self.sensing_at(self.first.snr)})
            return {"+".join(map(network_name, dataset.scenarios)): dataset}
        return {network_name(scenario): self._dataset_of(scenario) for scenario in axes.scenarios}

    def _dataset_of(self, scenario: str) -> DatasetStudy:
        """Return the settings of the dataset of one network of the sweep."""
        own = self.axes.datasets.get(scenario)
        sensing = self.sensing_at(self.first.snr)
        dataset = self.dataset.model_copy(update={"scenarios": (scenario,), "sensing": sensing})
        if own is not None:
            content = dataset.model_dump()
            if own.get("source", dataset.source) != dataset.source:
                # Another source has other sections, worlds and seeds; all else is as in the others.
                kept = DatasetStudy.model_fields.keys() - {"source", "world", "seeds"}
                content = {key: value for key, value in content.items() if key in kept}
            elif own.get("world", dataset.world) != dataset.world:
                # Sections that make another world are not those of this one.
                named = source_class(dataset.source).worlds.values()
                content = {key: value for key, value in content.items() if not any(key in of for of in named)}
            dataset = DatasetStudy.model_validate(merged(content, own))
        return dataset

    @property
    def first(self) -> WayOfSensing:
        """The way of sensing, by the sites, with which datasets are generated; other ways sense their records anew."""
        return next((sensing for sensing in sensings(self.axes) if sensing.sensor == DEFAULT), WayOfSensing(DEFAULT))

    @property
    def cells(self) -> list[Cell]:
        """Every combination of network, way of sensing and predictor."""
        axes = self.axes
        return [
            Cell(network, sensing, model)
            for network in self.networks
            for sensing in sensings(axes)
            for model in axes.models
        ]

    def sensing_at(self, snr: str | None) -> SensingSettings:
        """Return the study's sensing settings at another SNR, as `cosim sense --snr` takes it; None keeps its own."""
        if snr is None:
            return self.dataset.sensing
        content = self.dataset.sensing.model_dump()
        return SensingSettings.model_validate({**content, "channel": {**content["channel"], **channel(snr)}})

    def training_of(self, model: str, seed: int) -> TrainSettings:
        """Return the study's training settings for another predictor and training seed."""
        return self.training.for_predictor(model, seed)


def read_study(path: Path | None) -> Study:
    """Return the study of a file, or the bundled quick one. Raises InputError naming the key that is wrong."""
    file = Path(str(importlib.resources.files("isac_cosim.studies") / QUICK)) if path is None else path
    study = checked(Study, read_toml(file), file)
    return study if study.name else study.model_copy(update={"name": file.stem.strip(".") or "study"})
