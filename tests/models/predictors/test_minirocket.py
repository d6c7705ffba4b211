"""MiniRocket: the run, what its file may hold, and what is reported if the extra is not installed."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.models.data.windows import Records, Windows, WindowSettings, cut, draw_ends
from isac_cosim.models.predictors.minirocket import (
    MinirocketPredictor,
    MinirocketSettings,
    check,
    fit_rocket,
    read_rocket,
    write_rocket,
)
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

SETTINGS = SMALL_RUN.model_copy(update={"model": "minirocket", "minirocket": MinirocketSettings(features=1000)})
needs_aeon = pytest.mark.skipif(importlib.util.find_spec("aeon") is None, reason="the extra minirocket is missing")


def test_without_the_extra_the_error_says_what_to_install(
    records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"needs the optional package aeon: pip install '\.\[minirocket\]' in a checkout"
    ):
        train_records(records, MADE_OF, tmp_path / "run", SETTINGS)
    assert not (tmp_path / "run").exists()


def sound() -> dict[str, np.ndarray]:
    """Parts of a transform with two dilations."""
    channels_each = np.ones(168, np.int32)
    return {
        "channels_each": channels_each, "channels": np.arange(168, dtype=np.int32) % 6,
        "dilations": np.array([1, 4], np.int32),
        "features": np.array([2, 1], np.int32), "biases": np.zeros(252, np.float32),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("channels_each", np.full(168, 2, np.int32)),
        ("channels", np.full(168, 6, np.int32)),
        ("channels", np.full(168, -1, np.int32)),
        ("channels", np.zeros(168)),
        ("dilations", np.array([1, 11], np.int32)),
        ("dilations", np.array([0, 4], np.int32)),
        ("features", np.array([2, 2], np.int32)),
        ("biases", np.zeros(252)),
        ("biases", np.zeros((2, 126), np.float32)),
    ],
)
def test_parts_that_would_leave_their_arrays_are_refused(name: str, value: np.ndarray) -> None:
    check(tuple(sound().values()), 80)
    with pytest.raises(ValueError, match="not the parameters"):
        check(tuple({**sound(), name: value}.values()), 80)


@pytest.fixture(scope="module")
def rocket_run(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "rocket", SETTINGS)


@needs_aeon
def test_a_run_learns_is_loaded_and_answers_alike(records: Records, rocket_run: Run) -> None:
    test = records.take(np.isin(records.groups, rocket_run.card.split["test"]) & (records.label < 6))
    ends = draw_ends(test, WindowSettings(window_s=1.2, end_after_s=(1.0, 2.2)), "test")
    windows, label = cut(test, ends, SETTINGS.windows), test.label[ends.row]
    outputs = rocket_run.predictor(windows)
    assert (outputs.logits.argmax(axis=1) == label).mean() > 0.6
    np.testing.assert_array_equal(load_run(rocket_run.path).predictor(windows).logits, outputs.logits)
    alone = np.concatenate(
        [rocket_run.predictor(Windows(windows.tv[k : k + 1], windows.uv[k : k + 1])).logits for k in range(5)]
    )
    np.testing.assert_allclose(alone, outputs.logits[:5], atol=1e-6)


@needs_aeon
@pytest.mark.parametrize("taught", [(0, 3), (0, 2, 5)])
def test_what_is_stored_is_what_was_fitted(records: Records, taught: tuple[int, ...], tmp_path: Path) -> None:
    some = records.take(np.isin(records.label, taught))
    ends = draw_ends(some, SETTINGS.windows, "test")
    windows, label = cut(some, ends, SETTINGS.windows), some.label[ends.row]
    rocket = fit_rocket(windows, label, MinirocketSettings(features=400), seed=3)
    write_rocket(rocket, tmp_path / "rocket.npz")
    again = read_rocket(tmp_path / "rocket.npz", (windows.tv.shape[2], windows.uv.shape[2]))
    values = again.decide(windows)
    np.testing.assert_array_equal(values, rocket.decide(windows))
    assert values.shape == (len(label), len(taught))
    assert (np.array(taught)[values.argmax(axis=1)] == label).mean() > 0.9
    logits = MinirocketPredictor(again)(windows).logits
    assert logits.shape == (len(label), 6)
    np.testing.assert_array_equal(logits.argmax(axis=1), np.array(taught)[values.argmax(axis=1)])


@needs_aeon
def test_a_damaged_file_is_reported(rocket_run: Run, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(rocket_run.path, run)
    with np.load(run / "minirocket.npz") as stored:
        arrays = dict(stored)
    for change in ({"channels_0": arrays["channels_0"] + 6}, {"weight": np.array([{}], dtype=object)}):
        np.savez(run / "minirocket.npz", **{**arrays, **change})
        with pytest.raises(InputError, match="damaged"):
            load_run(run)
    del arrays["scale"]
    np.savez(run / "minirocket.npz", **arrays)
    with pytest.raises(InputError, match="damaged"):
        load_run(run)
