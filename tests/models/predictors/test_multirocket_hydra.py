"""MultiRocket with Hydra: against aeon's own classifier, the run, and what its file may hold."""

import importlib
import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from isac_cosim.base.errors import InputError
from isac_cosim.models.data.windows import Records, Windows, cut, draw_ends
from isac_cosim.models.predictors.multirocket_hydra import (
    Averaging,
    MultirocketHydraSettings,
    Scaling,
    fit_rocket,
    read_rocket,
    torch_left_alone,
    write_rocket,
)
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

SMALL = MultirocketHydraSettings(features=1344, groups=4)
SETTINGS = SMALL_RUN.model_copy(update={"model": "multirocket-hydra", "multirocket_hydra": SMALL})
needs_aeon = pytest.mark.skipif(importlib.util.find_spec("aeon") is None, reason="the extra minirocket is missing")


def test_without_the_extra_the_error_says_what_to_install(
    records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"needs the optional package aeon: pip install '\.\[minirocket\]' in a checkout"
    ):
        train_records(records, MADE_OF, tmp_path / "run", SETTINGS)


def test_torch_keeps_its_random_state_and_threads() -> None:
    state, threads = torch.random.get_rng_state(), torch.get_num_threads()
    with torch_left_alone():
        torch.manual_seed(0)
        torch.set_num_threads(threads + 1)
    assert torch.equal(torch.random.get_rng_state(), state)
    assert torch.get_num_threads() == threads


def test_features_that_are_seldom_there_weigh_little() -> None:
    counts = np.zeros((100, 2), np.float32)
    counts[:50, 0], counts[0, 1] = 1.0, 1.0
    scaled = Scaling.of(np.zeros((100, 1), np.float32), counts)(
        np.zeros((1, 1), np.float32), np.ones((1, 2), np.float32)
    )
    assert scaled[0, 0] == 0.0
    np.testing.assert_allclose(
        scaled[0, 1:], [(1 - 0.5) / (0.5 + 0.5**4), (1 - 0.01) / (np.std(counts[:, 1]) + 0.99**4)]
    )


def test_means_end_with_the_window() -> None:
    windows = Windows(np.arange(2 * 6 * 11, dtype=np.float32).reshape(2, 6, 11), np.ones((2, 6, 4), np.float32))
    means = Averaging.of(MultirocketHydraSettings(step_s=0.02), WindowShape(6, 11, 4, 200.0, 50.0))(windows)
    assert (means.tv.shape, means.uv.shape) == ((2, 6, 2), (2, 6, 4))
    np.testing.assert_array_equal(means.tv[1, 2, 1], windows.tv[1, 2, 7:].mean())
    np.testing.assert_array_equal(means.tv[1, 2, 0], windows.tv[1, 2, 3:7].mean())
    every = Averaging.of(MultirocketHydraSettings(step_s=0.0), WindowShape(6, 11, 4, 200.0, 50.0))
    np.testing.assert_array_equal(every(windows).tv, windows.tv)


@needs_aeon
def test_hydras_features_are_scaled_as_aeon_does() -> None:
    scaler = importlib.import_module("aeon.classification.convolution_based._hydra")._SparseScaler()
    counts = np.random.default_rng(1).poisson(0.4, (400, 30)).astype(np.float32)
    nothing = np.zeros((400, 1), np.float32)
    scaled = Scaling.of(nothing, np.sqrt(counts))(nothing, np.sqrt(counts))[:, 1:]
    # aeon divides by n - 1.
    np.testing.assert_allclose(scaled, scaler.fit_transform(torch.from_numpy(counts)).numpy(), rtol=3e-3)


@needs_aeon
def test_the_transforms_are_those_of_aeons_classifier(records: Records, tmp_path: Path) -> None:
    """With one stream twice, the features of each copy are those of aeon's transforms of that stream."""
    records = records.take(records.label < 6)
    ends = draw_ends(records, SETTINGS.windows, "test")
    windows = cut(records, ends, SETTINGS.windows)
    label = records.label[ends.row]
    rocket = fit_rocket(windows, label, SMALL, seed=3)
    library = importlib.import_module("aeon.transformations.collection.convolution_based")
    x = ((windows.uv - rocket.mean[1][:, None]) / rocket.sd[1][:, None]).astype(np.float32)
    features, counts = rocket.transforms[1](x)
    np.testing.assert_array_equal(features, library.MultiRocket(n_kernels=84, random_state=3).fit_transform(x))
    hydra = library.HydraTransformer(n_groups=4, random_state=3, output_type="numpy").fit_transform(x)
    np.testing.assert_allclose(counts**2, hydra.clip(0.0), atol=1e-3)

    write_rocket(rocket, tmp_path / "rocket.npz")
    again = read_rocket(tmp_path / "rocket.npz", (windows.tv.shape[2], windows.uv.shape[2]))
    np.testing.assert_array_equal(again.decide(windows), rocket.decide(windows))
    assert (rocket.ridge.classes[again.decide(windows).argmax(axis=1)] == label).mean() > 0.8


@pytest.fixture(scope="module")
def run(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "rocket", SETTINGS)


@needs_aeon
def test_a_run_learns_is_loaded_and_answers_each_window_alone(records: Records, run: Run, tmp_path: Path) -> None:
    test = records.take(np.isin(records.groups, run.card.split["test"]) & (records.label < 6))
    ends = draw_ends(test, SETTINGS.windows, "test")
    windows, label = cut(test, ends, SETTINGS.windows), test.label[ends.row]
    outputs = run.predictor(windows)
    assert (outputs.logits.argmax(axis=1) == label).mean() > 0.5
    np.testing.assert_array_equal(load_run(run.path).predictor(windows).logits, outputs.logits)
    alone = np.concatenate(
        [run.predictor(Windows(windows.tv[k : k + 1], windows.uv[k : k + 1])).logits for k in range(5)]
    )
    np.testing.assert_allclose(alone, outputs.logits[:5], atol=1e-4)
    again = train_records(records, MADE_OF, tmp_path / "again", SETTINGS)
    name = "multirocket_hydra.npz"
    assert (again.path / name).read_bytes() == (run.path / name).read_bytes()


@needs_aeon
@pytest.mark.parametrize("change", ["channels", "kernels", "hydra", "missing", "object"])
def test_a_damaged_file_is_reported(change: str, run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run.path, folder)
    with np.load(folder / "multirocket_hydra.npz") as stored:
        arrays = dict(stored)
    if change == "channels":
        arrays["differences_channels_1"] = arrays["differences_channels_1"] + 6
    elif change == "kernels":
        arrays["hydra_kernels_0"] = arrays["hydra_kernels_0"][:1]
    elif change == "hydra":
        arrays["hydra_channels_0"] = arrays["hydra_channels_0"] - 6
    elif change == "missing":
        del arrays["hydra_scale"]
    else:
        arrays["weight"] = np.array([{}], dtype=object)
    np.savez(folder / "multirocket_hydra.npz", **arrays)
    with pytest.raises(InputError, match="damaged"):
        load_run(folder)
