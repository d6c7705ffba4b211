"""A replay of an episode: which records, what a predictor answers, and what is said where the others are not known."""

from collections.abc import Generator, Iterable
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.evaluation.report.replay import others
from isac_cosim.evaluation.report.replay.content import Detected, TrackPath, at_rate
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.evaluation.report.replay.scene import SceneView
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.finding import find_episode, of_one
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.generation import recorded_again
from isac_cosim.models.data.windows import Ends, Records, cut, end_bounds
from isac_cosim.models.runs.run import Run
from tests.support.made_up_dataset import write_dataset


class HereEngine:
    """Runs tasks in this process."""

    workers = cores = 1

    def run(self, task: Any, items: Iterable[Any], threads: int = 1) -> Generator[Outcome[Any, Any]]:
        for item in items:
            try:
                yield Outcome(item, task(item), None, 0.0, 0)
            except ValueError as error:
                yield Outcome(item, None, str(error), 0.0, 0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_dataset(tmp_path_factory.mktemp("made_up") / "data")


def test_all_records_of_the_episode_are_shown_as_they_are_stored(dataset: Dataset) -> None:
    shard = find_episode(dataset, "toy-2")
    shown, samples = replay_of(dataset, shard, HereEngine()), dataset.samples(shard)
    assert [record.id for record in shown.records] == [sample.sample_id for sample in samples]
    for record, sample in zip(shown.records, samples, strict=True):
        assert np.array_equal(record.truth, at_rate(in_plane(sample.tv_truth, sample.x0, sample.y0), 400.0))
        assert np.array_equal(record.sensed, at_rate(in_plane(sample.tv, sample.x0, sample.y0), 400.0))
        assert record.maneuvers[0].onset_s == pytest.approx(sample.t_onset - sample.t_start)
    assert not shown.classes


def test_without_its_scenario_the_page_says_why_only_tv_and_uv_are_shown(dataset: Dataset) -> None:
    shown = replay_of(dataset, find_episode(dataset, "toy-2"), HereEngine())
    assert not any(record.others for record in shown.records)
    assert len(shown.remarks) == 1
    assert shown.remarks[0].startswith("TV and UV only: ")
    assert str(dataset.path) not in shown.remarks[0]


def test_an_episode_that_drives_otherwise_shows_tv_and_uv_only(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = Recording("toy", 2, 0.01, (), {})
    recorder = recorded_again.Recorder(dataset.path, None, None, {"toy": ""}, others.WHY, others.REMEDY)  # type: ignore[arg-type]
    monkeypatch.setattr(others.Recorder, "of", lambda *_: recorder)
    monkeypatch.setattr(recorded_again, "_load", lambda *_: None)
    monkeypatch.setattr(recorded_again, "recorded", lambda *_: recording)
    found, reason = others.around(dataset, find_episode(dataset, "toy-2"), HereEngine(), SILENT)
    assert found is None
    assert "is not the same when it is recorded again" in reason
    assert "scene" not in reason


def test_the_likeliest_intention_at_the_last_measured_window_decides_what_is_wrong(
    dataset: Dataset, trees_run: Run
) -> None:
    shard = find_episode(dataset, "toy-1")
    shown = replay_of(dataset, shard, HereEngine(), trees_run)
    records = Records.of(of_one(dataset, shard))
    windows = trees_run.card.settings.windows
    _, last = end_bounds(records, windows)
    likeliest = trees_run.answer(cut(records, Ends(np.arange(len(records)), last), windows)).probabilities.argmax(
        axis=1
    )
    classes = trees_run.card.classes
    for record, label, answer in zip(shown.records, records.label, likeliest, strict=True):
        assert record.answers is not None
        assert record.answers.predicted == classes[answer]
        assert record.answers.wrong == (None if label == 6 else bool(answer != label))
        count = len(record.answers.probabilities)
        assert record.answers.from_s + (count - 1) * record.answers.step_s <= 5.0


@pytest.mark.parametrize("name", ["toy-9", "", "../toy-1", "<script>", "toy-1.parquet"])
def test_an_unknown_episode_is_refused_with_those_there_are(name: str, dataset: Dataset) -> None:
    with pytest.raises(InputError, match=r"it has toy-0, toy-1, toy-2, toy-3"):
        find_episode(dataset, name)


@pytest.mark.parametrize("scene", [False, True])
def test_a_page_that_is_full_leaves_vehicles_out_and_says_so(
    scene: bool, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    from isac_cosim.evaluation.report.replay import making

    shard = find_episode(dataset, "toy-1")
    near = others.VehicleNear("v", "truck", 9.0, 2.5, 0.0, 0.2, np.zeros((2, 26)))
    beside = others.Around(((4.0, 2.0), (4.0, 2.0)), [near])
    track = TrackPath("1", 0.0, 0.2, np.zeros((2, 5)), np.ones((3, 5)))
    view = SceneView([track], Detected(0.0, 0.2, [np.zeros((3, 2))] * 5))
    whole = [beside] * shard.samples, [view] * shard.samples if scene else None
    monkeypatch.setattr(making, "around", lambda *_: (whole, ""))
    monkeypatch.setattr(making, "MOST_BYTES", 1000)
    shown = replay_of(dataset, shard, HereEngine())
    full = sum(bool(record.others) for record in shown.records)
    assert full == (1 if scene else 3)
    assert full < len(shown.records)
    assert sum(bool(record.tracks) for record in shown.records) == (full if scene else 0)
    assert f"From record {full + 1} on" in shown.remarks[0]
