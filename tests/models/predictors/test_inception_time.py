"""InceptionTime: its shapes, its size, and that it learns, saves and loads."""

from pathlib import Path

import numpy as np
import pytest
import torch

from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.predictors.inception_time import InceptionModule, InceptionNetwork, InceptionTimeSettings
from isac_cosim.models.runs.run import load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

SMALL = InceptionTimeSettings(length=30, filters=4, depth=3, kernels=(9, 5, 3))


def test_a_module_is_its_convolutions_side_by_side() -> None:
    torch.manual_seed(0)
    module = InceptionModule(12, SMALL).eval()
    x = torch.randn(2, 12, 30)
    parts = module(x).split(4, dim=1)
    narrow = torch.einsum("fc,bct->bft", module.bottleneck.weight[:, :, 0], x)
    weight = module.convolutions[1].weight.detach()
    padded = torch.nn.functional.pad(narrow, (2, 2)).detach()
    by_hand = sum(torch.einsum("fg,bgt->bft", weight[:, :, k], padded[:, :, k : k + 30]) for k in range(5))
    scale = 1 / (1 + module.norm.eps) ** 0.5
    torch.testing.assert_close(parts[1], torch.relu(by_hand * scale), atol=1e-5, rtol=1e-4)
    largest = torch.stack([x.roll(shift, dims=2) for shift in (-1, 0, 1)]).amax(dim=0)[..., 1:-1]
    expected = torch.einsum("fc,bct->bft", module.pooled[1].weight[:, :, 0], largest)
    torch.testing.assert_close(parts[3][..., 1:-1], torch.relu(expected * scale), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("depth", [1, 3, 4, 6])
def test_any_depth_gives_features_of_one_width(depth: int) -> None:
    network = InceptionNetwork(SMALL.model_copy(update={"depth": depth}), 6).eval()
    assert len(network.shortcuts) == depth // 3
    assert network.features(torch.randn(3, 6, 480), torch.randn(3, 6, 120)).shape == (3, 16)


def test_the_default_network_has_the_size_of_the_paper_s() -> None:
    """Half a million weights in six modules of 32 filters; the exact number by the sizes of its convolutions."""
    network = InceptionNetwork(InceptionTimeSettings(), 6)
    first, others = 12 * 32 * 2, 128 * 32 * 2
    convolutions, norms = 32 * 32 * (39 + 19 + 9), 2 * 128
    shortcuts = 12 * 128 + 128 * 128 + 2 * 2 * 128
    head = 128 * 6 + 6
    expected = first + 5 * others + 6 * (convolutions + norms) + shortcuts + head
    assert network.parameter_count == expected


def test_it_learns_and_answers_as_before_when_loaded(records: Records, tmp_path: Path) -> None:
    optimiser = {**SMALL_RUN.optimiser.model_dump(), "epochs": 8}
    own = {"model": "inception-time", "inception_time": SMALL.model_dump(), "optimiser": optimiser}
    content = {**SMALL_RUN.model_dump(), **own}
    settings = TrainSettings.model_validate(content)
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    known = records.take(records.label < 6)
    ends = draw_ends(known, settings.windows, "test")
    windows = cut(known, ends, settings.windows)
    outputs = run.predictor(windows)
    np.testing.assert_array_equal(load_run(run.path).predictor(windows).logits, outputs.logits)
    assert (outputs.logits.argmax(axis=1) == known.label[ends.row]).mean() > 0.35
    # Each answer depends on its own window alone, also through the batch normalisation.
    alone = run.predictor(cut(known, ends[:1], settings.windows))
    np.testing.assert_allclose(alone.logits, outputs.logits[:1], atol=1e-5)
