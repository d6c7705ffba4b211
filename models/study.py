"""A whole study: the dataset, the predictor and its evaluation, read from one TOML file."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from pydantic import Field

from isacsim.settings import Settings
from labeling.study import DatasetStudy, checked, read_toml
from models.evaluation import EvaluateSettings
from models.run import TrainSettings

QUICK = "quick.toml"
"""The bundled study that runs when none is named."""


class Study(Settings):
    """Everything between scenarios and results.

    name: of the folder of results where none is given; the file's name when absent.
    """

    name: str = Field("", pattern=r"^[A-Za-z0-9_-]*$")
    dataset: DatasetStudy = DatasetStudy()
    training: TrainSettings = TrainSettings()
    evaluation: EvaluateSettings = EvaluateSettings()

    @property
    def floor(self) -> TrainSettings:
        """The plain predictor to compare with: boosted trees on the same windows and split."""
        return self.training.model_copy(update={"model": "trees"})


def read_study(path: Path | None) -> Study:
    """A study from its file, or the bundled quick one. Raises InputError naming the key that is wrong."""
    file = Path(str(importlib.resources.files("studies") / QUICK)) if path is None else path
    study = checked(Study, read_toml(file), file)
    return study if study.name else study.model_copy(update={"name": file.stem})
