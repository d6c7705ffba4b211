"""Where networks answer: on any device as a whole, on a GPU where there is one."""

import pytest
import torch

from isac_cosim.models.predictors.network_predictor import NetworkPredictor, answering_device
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.registry import OWN
from isac_cosim.models.runs.settings import TrainSettings

SHAPE = WindowShape(6, 80, 20, 400.0, 100.0)
NETWORKS = [name for name, kind in OWN.items() if issubclass(kind, NetworkPredictor)]


@pytest.mark.parametrize("name", NETWORKS)
def test_nothing_of_a_network_stays_behind_on_the_cpu(name: str) -> None:
    """A device without memory stands for a GPU; most operations on tensors of two devices fail."""
    kind = OWN[name]
    assert issubclass(kind, NetworkPredictor)
    network = kind.build(TrainSettings(model=name), SHAPE).to("meta")
    tv, uv = (torch.empty(3, 6, length, device="meta") for length in (SHAPE.tv_length, SHAPE.uv_length))
    for training in (False, True):
        features = network.train(training).features(tv, uv)
        logits = network.classify(features)
        assert features.device.type == logits.device.type == "meta"
        assert logits.shape == (3, 6)


@pytest.mark.parametrize(
    ("accelerator", "available", "device"),
    [
        ("auto", False, "cpu"),
        ("gpu", False, "cpu"),
        ("auto", True, "cuda"),
        ("gpu", True, "cuda"),
        ("cpu", True, "cpu"),
    ],
)
def test_a_gpu_answers_where_there_is_one(
    accelerator: str, available: bool, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: available)
    assert answering_device(accelerator) == torch.device(device)
