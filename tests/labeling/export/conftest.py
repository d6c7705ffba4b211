"""The dataset of one short episode that is exported, and its recording."""

from __future__ import annotations

import pytest

from isac_cosim.base.settings import checked
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.recorded_again import Recorder
from isac_cosim.labeling.generation.settings import DatasetStudy

EPISODE = "motorway-1"
STUDY = {
    "scenarios": ["motorway"],
    "seeds": {"first": 1, "last": 1},
    "traffic": {"run_in_s": 40.0, "duration_s": 30.0},
}


@pytest.fixture(scope="package")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    with LocalEngine(1).started() as pool:
        return generate(
            checked(DatasetStudy, STUDY, "study"),
            tmp_path_factory.mktemp("exported") / "data",
            KeptWorkers(lambda: pool, 1, 1),
        )


@pytest.fixture(scope="package")
def recording(dataset: Dataset) -> Recording:
    """The episode, recorded again in this process."""
    return Recorder.of(dataset).record("motorway", 1, dataset.samples(dataset.meta.shards[0]))
