"""Scripted traffic, watched and predicted."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.models.runs.run import Run
from tests.support.scripted import ScriptedSource


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    """Two pairs of vehicles on a straight road: one follower brakes hard, one changes lane to the left."""
    return ScriptedSource(tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="session")
def scenario(source: ScriptedSource) -> Scenario:
    return source.load("road")


@pytest.fixture(scope="session")
def recording(source: ScriptedSource, scenario: Scenario) -> Recording:
    return source.record(scenario, 1)


@pytest.fixture(scope="session")
def study(trees_run: Run) -> LiveStudy:
    """The evaluation of small trees: two development seeds, two measured ones."""
    content = study_of(trees_run.card, "road", (11, 12), (21, 22)).model_dump()
    content["live"]["background"] |= {"rounds": 10, "folds": 2}
    content["live"]["choice"] |= {"thresholds": 20, "confirmations": [[1, 1], [2, 3]], "least_probabilities": [0.0]}
    content["live"]["streams"] |= {"report_delay_s": 0.0}
    return LiveStudy.model_validate(content)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("evaluation")
