"""Exported programs answer what the network answers, for any number of windows."""

from pathlib import Path

import numpy as np
import pytest
import torch

from isacsim.errors import InputError
from models.data.windows import Records, Windows, cut, draw_ends
from models.export import write_export
from models.predictors.aligned import AlignedSettings
from models.predictors.castformer import CastformerSettings
from models.predictors.network_predictor import NetworkPredictor
from models.predictors.registry import PREDICTORS
from models.run import Run
from tests.support.made_up import SMALL_RUN

SHORT = {"tv_length": 32, "uv_length": 8}
SETTINGS = SMALL_RUN.model_copy(
    update={
        "castformer": CastformerSettings(width=16, heads=4, encoder_layers=1, frame_s=0.04),
        "aligned": AlignedSettings(length=8, hidden=8),
    }
)


def assert_same(run: Run, file: Path, windows: Windows) -> None:
    program = torch.export.load(file).module()
    for n in (1, 7):
        part = Windows(windows.tv[:n], windows.uv[:n])
        logits, features = program(torch.from_numpy(part.tv), torch.from_numpy(part.uv))
        expected = run.predictor(part)
        np.testing.assert_allclose(logits.detach().numpy(), expected.logits, atol=1e-5)
        np.testing.assert_allclose(features.detach().numpy(), expected.features, atol=1e-5)


@pytest.mark.parametrize("model", ["asi-bip", "castformer", "aligned"])
def test_a_written_program_answers_like_the_network(model: str, network_run: Run, tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"model": model})
    card = network_run.card.model_copy(update={"settings": settings, **SHORT})
    kind = PREDICTORS[model]
    assert issubclass(kind, NetworkPredictor)
    run = Run(network_run.path, card, kind(kind.build(settings, card.shape).eval()), network_run.reference)
    rng = np.random.default_rng(0)
    tv, uv = (rng.normal(size=(7, 6, length)).astype(np.float32) for length in SHORT.values())
    assert_same(run, write_export(run, tmp_path / "network.pt2"), Windows(tv, uv))


@pytest.mark.slow
def test_a_trained_network_exports(records: Records, network_run: Run, tmp_path: Path) -> None:
    windows = cut(records, draw_ends(records, SMALL_RUN.windows, "test")[:7], SMALL_RUN.windows)
    assert_same(network_run, write_export(network_run, tmp_path / "network.pt2"), windows)


def test_trees_and_other_names_are_refused(network_run: Run, trees_run: Run, tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"not a single network; export a run of one of asi-bip, .*castformer",
    ):
        write_export(trees_run, tmp_path / "trees.pt2")
    with pytest.raises(InputError, match=r"\.pt2"):
        write_export(network_run, tmp_path / "network.onnx")
    assert list(tmp_path.iterdir()) == []
