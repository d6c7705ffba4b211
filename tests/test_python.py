"""The short ways in from Python: what they give is what the commands give, and docs/python.md runs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch

import cosim
import isac_cosim
from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.evaluation.on_windows.results import read_metrics
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Windows, WindowSettings, cut
from isac_cosim.models.networks.lightning_module import WindowData
from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train
from isac_cosim.opened import OpenedDataset
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset

PAGE = Path(cosim.__file__).parent / "docs" / "python.md"
TREES = SMALL_RUN.for_predictor("trees")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("python") / "DATASET"
    write_dataset(path, seeds=5, passing=True)
    return path


@pytest.fixture
def dataset(folder: Path) -> OpenedDataset:
    return isac_cosim.open(folder)


@pytest.fixture(scope="module")
def run(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train(Dataset.open(folder), tmp_path_factory.mktemp("runs") / "trees", TREES)


def test_the_page_runs(folder: Path, monkeypatch: pytest.MonkeyPatch, one_thread: None) -> None:
    """Each of its examples is of ten lines or so, but for the module that Lightning needs."""
    monkeypatch.chdir(folder.parent)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert len(blocks) == 5
    assert sorted(len(block.splitlines()) for block in blocks)[-2] <= 11
    assert Path("sample.png").read_bytes().startswith(b"\x89PNG")
    for measured in ("measured", "measured_trees"):
        metrics = json.loads(Path(measured, "metrics.json").read_text())
        assert metrics["n"] > 0
        assert metrics["macro_f1"] is not None
        assert Path(measured, "predictions.parquet").is_file()


def test_training_windows_are_those_of_the_tools_own_training(dataset: OpenedDataset, run: Run) -> None:
    """The windows that Lightning's module draws in an epoch, from records of the run's own training side."""
    assert dataset.split(TREES) == run.card.split
    windows, data = dataset.windows("train", TREES, epoch=2), dataset.data_module(TREES)
    assert set(windows.groups) == set(run.card.split["train"])
    ends = data.epoch_ends(2)
    np.testing.assert_array_equal(windows.ends.step, ends.step)
    expected = cut(data.training, ends, TREES.windows)
    tv, uv, label = windows.arrays()
    np.testing.assert_array_equal(tv, expected.tv)
    np.testing.assert_array_equal(uv, expected.uv)
    np.testing.assert_array_equal(label, data.training.label[ends.row])
    first = windows[3]
    assert torch.equal(first[0], torch.from_numpy(expected.tv[3]))
    assert torch.equal(first[1], torch.from_numpy(expected.uv[3]))
    assert first[2] == label[3]
    assert not np.array_equal(dataset.windows("train", TREES, epoch=1).ends.step, ends.step)


def test_test_windows_are_those_that_are_evaluated(dataset: OpenedDataset, run: Run, tmp_path: Path) -> None:
    (measured,) = evaluate(run, dataset, None).measured
    windows = dataset.windows("test", TREES, unknown=True)
    assert windows.table()["sample_id"].tolist() == measured.predictions.sample_id.tolist()
    np.testing.assert_array_equal(windows.table()["lead_s"], measured.predictions.lead_s)
    outputs = run.answer(next(windows.batches()))
    np.testing.assert_array_equal(outputs.logits, measured.predictions.outputs.logits[: len(outputs.logits)])
    assert set(dataset.windows("test", TREES).labels) <= set(KNOWN)
    assert Intention.FOLLOWING in windows.labels


def test_an_intention_that_is_held_out_is_in_no_window(dataset: OpenedDataset) -> None:
    held_out = TREES.model_copy(update={"held_out": "overtake"})
    assert Intention.OVERTAKE not in dataset.windows("train", held_out).labels
    assert Intention.OVERTAKE in dataset.windows("train", held_out, unknown=True).labels


def test_lightnings_module_is_the_one_of_the_trainings(dataset: OpenedDataset) -> None:
    data = dataset.data_module(SMALL_RUN)
    assert isinstance(data, WindowData)
    validation = dataset.windows("validation", SMALL_RUN)
    np.testing.assert_array_equal(data.fixed.step, validation.ends.step)
    assert set(data.validation.groups) == set(dataset.split(SMALL_RUN)["validation"])


def without_names(path: Path) -> dict[str, object]:
    """The metrics of a file, but for which run they are of."""
    metrics = json.loads(path.read_text())
    del metrics["made_by"]["runs"]
    return {key: value for key, value in metrics.items() if key not in ("model", "name")}


def test_a_classifier_gets_the_figures_of_the_commands(dataset: OpenedDataset, run: Run, tmp_path: Path) -> None:
    """Trained and evaluated by the commands' own functions, or fitted and measured from Python: the same file."""
    evaluate(run, dataset, tmp_path / "command")
    classifier = isac_cosim.IntentionClassifier("trees").fit(dataset.windows("train", SMALL_RUN))
    result = isac_cosim.evaluate(classifier, dataset, tmp_path / "python")
    assert without_names(tmp_path / "python/metrics.json") == without_names(tmp_path / "command/metrics.json")
    assert (result.name, result.model) == ("boosted trees", "trees")
    windows = dataset.windows("test", SMALL_RUN)
    tv, uv, _ = windows.arrays()
    np.testing.assert_array_equal(classifier.predict_proba(windows), classifier.predict_proba((tv, uv)))
    assert classifier.get_params() == {"model": "trees"}
    assert classifier.predict_proba(windows).shape == (len(windows), len(classifier.classes_))


def test_a_function_gets_the_figures_of_the_predictor_that_it_asks(
    dataset: OpenedDataset, run: Run, tmp_path: Path
) -> None:
    """With logits and features it is measured to the last digit as the predictor itself is."""
    evaluate(run, dataset, tmp_path / "command")

    def asked(tv: Float32Array, uv: Float32Array) -> Outputs:
        return run.predictor(Windows(tv, uv))

    asked.__name__ = run.name
    isac_cosim.evaluate(asked, dataset, tmp_path / "python", training=TREES)
    assert without_names(tmp_path / "python/metrics.json") == without_names(tmp_path / "command/metrics.json")


def test_probabilities_are_measured_beside_a_run(dataset: OpenedDataset, run: Run, tmp_path: Path) -> None:
    """Of probabilities that know the answer every window is right; the file opens again, with the function's name."""
    windows = dataset.windows("test", TREES, unknown=True)
    tv, _, label = windows.arrays()
    known = {states.tobytes(): number for states, number in zip(tv, label, strict=True)}

    def oracle(tv: Float32Array, uv: Float32Array) -> Array:
        number = np.array([known.get(states.tobytes(), 0) % 6 for states in tv])
        return np.eye(6)[number]

    result = isac_cosim.evaluate(oracle, dataset, tmp_path / "oracle", against=[run], training=TREES)
    assert result.name == "oracle"
    assert result.accuracy == 1.0
    assert [other.name for other in result.compared] == ["boosted trees"]
    again = read_metrics(tmp_path / "oracle")
    assert again is not None
    assert again.accuracy == 1.0


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (lambda tv, uv: np.ones((len(tv), 5)) / 5, r"answers \d+ windows with shape \(\d+, 5\)"),
        (lambda tv, uv: np.ones((len(tv), 6)), "each row must add up to 1"),
        (lambda tv, uv: np.full((len(tv), 6), np.nan), "each row must add up to 1"),
        (lambda tv, uv: np.tile([2.0, -1, 0, 0, 0, 0], (len(tv), 1)), "each row must add up to 1"),
    ],
)
def test_what_is_no_probability_is_refused(dataset: OpenedDataset, answer: object, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        isac_cosim.evaluate(answer, dataset, training=TREES)  # type: ignore[arg-type]


def test_what_cannot_be_is_one_line(dataset: OpenedDataset, run: Run) -> None:
    with pytest.raises(InputError, match=r"split 'tset': did you mean test\? choose one of train, validation, test"):
        dataset.windows("tset")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"has no sample 'toy-0-99'; did you mean toy-0-"):
        dataset.plot("toy-0-99")
    with pytest.raises(IndexError):
        dataset.plot(len(dataset))
    with pytest.raises(InputError, match=r"fit to windows\(split=\"train\"\)"):
        isac_cosim.IntentionClassifier().fit(dataset.windows("test"))
    with pytest.raises(InputError, match="is not fitted"):
        isac_cosim.IntentionClassifier().predict_proba(dataset.windows("test"))
    with pytest.raises(InputError, match="has its own settings; leave it out"):
        isac_cosim.evaluate(run, dataset, training=TREES)
    with pytest.raises(InputError, match="exceeds the records"):
        dataset.windows("train", SMALL_RUN.model_copy(update={"windows": WindowSettings(window_s=9)}))


def test_a_function_can_be_neither_trained_nor_loaded(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its name in results is none that `cosim train` offers or takes."""
    assert cosim.main(["train", str(folder), "-o", str(tmp_path / "run"), "--model", "function"]) == 2
    error = capsys.readouterr().err
    assert "is no predictor that can be trained" in error
    assert not (tmp_path / "run").exists()


def test_a_drawing_shows_itself(dataset: OpenedDataset, run: Run) -> None:
    bare, answered = dataset.plot(-1), dataset.plot(len(dataset) - 1, run)
    assert bare._repr_png_().startswith(b"\x89PNG")
    assert bare.png != answered.png
    name = dataset.frame(["sample_id"])["sample_id"].iloc[-1]
    assert dataset.plot(name).png == bare.png
