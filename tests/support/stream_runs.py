"""Streams of scripted traffic, and small predictors trained on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.streams.dataset import Streams
from isac_cosim.labeling.streams.generate import generate_streams
from isac_cosim.models.runs.settings import TrainSettings
from tests.support.scripted import InlineEngine, ScriptedSource

STUDY = DatasetStudy.model_validate(
    {"scenarios": ["road"], "seeds": {"first": 1, "last": 3}, "sensing": {"channel": {"kind": "link"}}}
)
SMALL: dict[str, Any] = {
    "least_events": 1,
    "hard_share": 1.0,
    "easy_share": 0.5,
    "trees": {"rounds": 30, "least_leaf": 3, "feature_share": 1.0},
    "causal": {"width": 32, "dropout": 0.0},
}


def settings(model: str, **streams: object) -> TrainSettings:
    """Settings of a training that takes seconds; streams: other settings of its section."""
    optimiser = {"epochs": 15, "batch": 1, "patience": 15, "learning_rate": 5e-3} if model == "causal" else {}
    return TrainSettings.model_validate({"model": model, "streams": SMALL | streams, "optimiser": optimiser})


def scripted_streams(folder: Path) -> Streams:
    """Generate the streams of three seeds."""
    scenario = folder / "scenario"
    scenario.mkdir()
    return generate_streams(STUDY, folder / "streams", InlineEngine(), source=ScriptedSource(scenario))
