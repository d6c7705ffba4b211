"""Datasets of the kinematic source: generated labels, checked by the detectors; sensed anew, trained, evaluated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.command_line.arguments import SenseArguments, dataset_study, resense_settings
from isac_cosim.evaluation.on_windows.evaluation import Evaluation, evaluate
from isac_cosim.evaluation.report.report import write_report
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.summary import show, summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import resense
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train
from tests.support.scripted import InlineEngine

EPISODES, PER_CLASS = 3, 3
CONTENT = {
    "scenarios": ["straight_road"],
    "source": "kinematic",
    "seeds": {"first": 1, "last": EPISODES},
    "kinematics": {"per_class": PER_CLASS, "following_scenes": 2},
    "record": {"tv_rate_hz": 40.0, "uv_rate_hz": 20.0},
}
STUDY = checked(DatasetStudy, CONTENT, "test")
INLINE = InlineEngine()


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return generate(STUDY, tmp_path_factory.mktemp("kinematic") / "data", INLINE)


def test_every_scene_becomes_a_sample_with_the_label_of_its_source(dataset: Dataset) -> None:
    dataset.verify()
    known = {intention.text: EPISODES * PER_CLASS for intention in Intention}
    assert dataset.meta.by_intention() == {**known, "following": EPISODES * 2}
    frame = dataset.frame()
    assert set(frame["source"]) == {"kinematic"}
    assert (frame["tv_id"].str.removeprefix("tv") == frame["uv_id"].str.removeprefix("uv")).all()
    assert set(frame.loc[frame["intention"] == "following", "origin"]) == {"natural"}
    assert set(frame.loc[frame["intention"] == "overtake", "origin"]) == {"commanded"}
    assert set(frame.loc[frame["intention"] == "hard_brake", "origin"]) == {"reaction", "commanded"}
    assert (frame["n_sites"] == 4).all()


def test_states_of_the_target_follow_the_road_of_the_dataset(dataset: Dataset) -> None:
    truth = dataset.arrays("tv_truth")["tv_truth"].astype(np.float64)
    lanes = [lane.shape[:, 1] for lane in dataset.roads("straight_road")]
    assert min(map(np.min, lanes)) - 1.8 < truth[:, 1].min() < truth[:, 1].max() < max(map(np.max, lanes)) + 1.8
    steps = np.diff(truth[:, 0], axis=1) * dataset.meta.tv_rate_hz
    np.testing.assert_allclose(steps, (truth[:, 2, 1:] + truth[:, 2, :-1]) / 2, atol=0.02)


def test_the_summary_reports_how_far_the_detectors_agree(dataset: Dataset) -> None:
    values = summary(dataset)
    agreed = values["label_agreement"]
    assert {name: sum(verdicts.values()) for name, verdicts in agreed.items()} == {
        name: number for name, number in dataset.meta.by_intention().items() if number
    }
    right = sum(verdicts.get(name, 0) for name, verdicts in agreed.items())
    assert right >= 0.97 * len(dataset)
    assert not [key for key in values["counts"] if key.startswith("generated")]
    console = Console(width=160, record=True, file=None, quiet=False)
    with console.capture() as output:
        show(values, console)
    assert "labels of the source and of the detectors" in output.get()


def test_the_samples_do_not_depend_on_the_workers_and_an_interrupted_dataset_goes_on(
    tmp_path: Path, two_workers: KeptWorkers
) -> None:
    few = {"seeds": {"first": 1, "last": 2}, "kinematics": {"per_class": 1, "following_scenes": 0}}
    study = checked(DatasetStudy, {**CONTENT, **few}, "test")
    parallel = generate(study, tmp_path / "parallel", two_workers)
    digest = parallel.digest
    parallel.shard_path(parallel.meta.shards[1]).unlink()
    assert generate(study, tmp_path / "parallel", INLINE).digest == digest
    assert generate(study, tmp_path / "inline", INLINE).digest == digest


def test_sensing_anew_gives_the_same_bytes_and_truth_is_the_truth(dataset: Dataset, tmp_path: Path) -> None:
    same = resense(dataset, resense_settings(dataset, SenseArguments("isac")), tmp_path / "same", INLINE)
    same.verify()
    assert np.array_equal(same.arrays("tv")["tv"], dataset.arrays("tv")["tv"])
    true = resense(dataset, resense_settings(dataset, SenseArguments("truth")), tmp_path / "truth", INLINE)
    assert np.array_equal(true.arrays("tv")["tv"], dataset.arrays("tv_truth")["tv_truth"])


@pytest.fixture(scope="module")
def evaluation(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Evaluation:
    folder = tmp_path_factory.mktemp("run")
    settings = checked(
        TrainSettings,
        {"model": "trees", "trees": {"rounds": 5}, "pre_onset": {"rounds": 5}, "optimiser": {"threads": 1}},
        "test",
    )
    return evaluate(train(dataset, folder / "run", settings), dataset, folder / "evaluation")


def test_a_predictor_trains_and_is_evaluated(evaluation: Evaluation) -> None:
    assert evaluation.result.n > 0
    assert set(evaluation.result.per_class_f1) == {intention.text for intention in KNOWN}


@pytest.mark.slow
def test_the_report_draws_a_record(dataset: Dataset, evaluation: Evaluation, tmp_path: Path) -> None:
    page = write_report(evaluation, dataset, tmp_path)
    assert (page.parent / "record.png").stat().st_size > 10_000


def test_the_study_of_another_source_does_not_mention_the_kinematic_settings() -> None:
    assert "kinematics" in STUDY.model_dump()
    plain = DatasetStudy()
    assert "kinematics" not in plain.model_dump()
    assert checked(DatasetStudy, plain.model_dump(), "test") == plain


def test_the_command_line_knows_the_scenario_of_the_source() -> None:
    study = dataset_study([], 100, None, None, "kinematic")
    assert (study.scenarios, study.source) == (("straight_road",), "kinematic")
    assert dataset_study(["motorway"], 100, None, None).source == "sumo"
    with pytest.raises(InputError, match="Missing argument 'SCENARIO'"):
        dataset_study([], 100, None, None)
