"""The networks: what they compute, which weights they take, and that random ones depend on the seed alone."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional

from isac_cosim.base.errors import InputError
from isac_cosim.models.video.encoders import encoder, projection
from isac_cosim.models.video.face_network import MobileFaceNet
from isac_cosim.models.video.resnet import ResNet18
from isac_cosim.models.video.settings import VideoSettings

SETTINGS = VideoSettings()


def trained(network: torch.nn.Module) -> dict[str, Tensor]:
    """A state as after training: statistics that are not 0 and 1, and positive variances."""
    torch.manual_seed(0)
    state = network.state_dict()
    for name, value in state.items():
        if name.endswith(("running_var", "bn.weight", "bn1.weight", "bn2.weight")):
            value.uniform_(0.5, 2)
        elif value.ndim == 1 and value.is_floating_point():
            value.uniform_(-0.3, 0.3)
    return state


def normalised(state: dict[str, Tensor], name: str, x: Tensor) -> Tensor:
    part = {key: state[f"{name}.{key}"] for key in ("weight", "bias", "running_mean", "running_var")}
    shape = (-1, 1, 1) if x.ndim == 4 else (-1,)
    mean, var, scale, shift = (part[key].view(shape) for key in ("running_mean", "running_var", "weight", "bias"))
    return (x - mean) / (var + 1e-5).sqrt() * scale + shift


def resnet_by_hand(state: dict[str, Tensor], x: Tensor) -> Tensor:
    """ResNet-18 from its table in the paper, by the names of torchvision."""
    x = normalised(state, "bn1", functional.conv2d(x, state["conv1.weight"], stride=2, padding=3)).relu()
    x = functional.max_pool2d(x, 3, 2, 1)
    for layer in range(1, 5):
        for block in range(2):
            at, stride = f"layer{layer}.{block}", 2 if layer > 1 and block == 0 else 1
            y = functional.conv2d(x, state[f"{at}.conv1.weight"], stride=stride, padding=1)
            y = functional.conv2d(normalised(state, f"{at}.bn1", y).relu(), state[f"{at}.conv2.weight"], padding=1)
            if f"{at}.downsample.0.weight" in state:
                x = functional.conv2d(x, state[f"{at}.downsample.0.weight"], stride=stride)
                x = normalised(state, f"{at}.downsample.1", x)
            x = (normalised(state, f"{at}.bn2", y) + x).relu()
    return functional.linear(x.mean(dim=(2, 3)), state["fc.weight"], state["fc.bias"])


def face_by_hand(state: dict[str, Tensor], x: Tensor) -> Tensor:
    """MobileFaceNet from its table in the paper, by the names of InsightFace_Pytorch."""

    def block(x: Tensor, at: str, stride: int = 1, padding: int = 0) -> Tensor:
        weight = state[f"{at}.conv.weight"]
        groups = x.shape[1] // weight.shape[1]
        x = normalised(state, f"{at}.bn", functional.conv2d(x, weight, None, stride, padding, groups=groups))
        return functional.prelu(x, state[f"{at}.prelu.weight"]) if f"{at}.prelu.weight" in state else x

    def bottleneck(x: Tensor, at: str, stride: int) -> Tensor:
        return block(block(block(x, f"{at}.conv"), f"{at}.conv_dw", stride, 1), f"{at}.project")

    x = block(block(x, "conv1", 2, 1), "conv2_dw", 1, 1)
    for number, count in (("3", 4), ("4", 6), ("5", 2)):
        x = bottleneck(x, {"3": "conv_23", "4": "conv_34", "5": "conv_45"}[number], 2)
        for k in range(count):
            x = x + bottleneck(x, f"conv_{number}.model.{k}", 1)
    x = block(block(x, "conv_6_sep"), "conv_6_dw").flatten(1)
    x = normalised(state, "bn", functional.linear(x, state["linear.weight"]))
    return x / x.norm(dim=1, keepdim=True)


def test_resnet_is_that_of_the_paper() -> None:
    network = ResNet18(1000)
    assert sum(parameter.numel() for parameter in network.parameters()) == 11_689_512  # as torchvision states
    network.load_state_dict(state := trained(network))
    x = torch.randn(2, 3, 96, 144)
    with torch.inference_mode():
        torch.testing.assert_close(network.eval()(x), resnet_by_hand(state, x), rtol=1e-3, atol=1e-3)


def test_the_face_network_is_that_of_the_paper() -> None:
    network = MobileFaceNet(512)
    network.load_state_dict(state := trained(network))
    x = torch.rand(2, 3, 112, 112) * 2 - 1
    with torch.inference_mode():
        torch.testing.assert_close(network.eval()(x), face_by_hand(state, x), rtol=1e-3, atol=1e-4)


def pictures(view: str) -> np.ndarray:
    shape = (3, 3, 96, 144) if view == "road" else (3, 3, 112, 112)
    return np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)


@pytest.mark.parametrize(("view", "width"), [("road", 32), ("driver", 64)])
def test_random_weights_depend_on_the_seed_alone(view: Any, width: int) -> None:
    state = torch.random.get_rng_state()
    features = encoder(view, None, SETTINGS)(pictures(view))
    assert torch.equal(torch.random.get_rng_state(), state)
    torch.manual_seed(99)
    np.testing.assert_array_equal(encoder(view, None, SETTINGS)(pictures(view)), features)
    assert features.shape == (3, width)
    assert features.dtype == np.float32
    assert (features.std(axis=0) > 0).all()
    other = encoder(view, None, VideoSettings(seed=1))(pictures(view))
    assert (other != features).any(axis=1).all()


@pytest.mark.parametrize(("view", "kind"), [("road", ResNet18), ("driver", MobileFaceNet)])
def test_weights_of_the_papers_width_are_used_as_they_are(tmp_path: Path, view: Any, kind: Any) -> None:
    network = kind(32 if view == "road" else 64)
    network.load_state_dict(trained(network))
    torch.save(
        {"state_dict": {f"module.{name}": value for name, value in network.state_dict().items()}}, tmp_path / "w"
    )
    with torch.inference_mode():
        expected = network.eval()(torch.from_numpy(pictures(view))).numpy()
    np.testing.assert_array_equal(encoder(view, tmp_path / "w", SETTINGS)(pictures(view)), expected)


@pytest.mark.parametrize(("view", "kind", "width"), [("road", ResNet18, 1000), ("driver", MobileFaceNet, 512)])
def test_published_weights_are_projected(tmp_path: Path, view: Any, kind: Any, width: int) -> None:
    """As old files are: not zipped, without counts of batches."""
    network = kind(width)
    network.load_state_dict(state := trained(network))
    old = {name: value for name, value in state.items() if "num_batches" not in name}
    torch.save(old, tmp_path / "w", _use_new_zipfile_serialization=False)
    x = torch.from_numpy(pictures(view))
    with torch.inference_mode():
        features = network.eval().features(x).numpy()
    wanted = 32 if view == "road" else 64
    matrix = projection(512, wanted, 0, view).numpy()
    np.testing.assert_allclose(matrix.T @ matrix, np.eye(wanted), atol=1e-5)
    found = encoder(view, tmp_path / "w", SETTINGS)(pictures(view))
    np.testing.assert_allclose(found, features @ matrix, rtol=1e-4, atol=1e-5)


class Bomb:
    def __reduce__(self) -> Any:
        return os.mkdir, ("exploded",)


def spoilt(state: dict[str, Any], kind: str) -> Any:
    if kind == "missing":
        del state["layer1.0.conv1.weight"]
    elif kind == "shape":
        state["conv1.weight"] = torch.zeros(64, 2, 7, 7)
    elif kind == "foreign":
        state["layer5\n.weight"] = torch.zeros(2)
    elif kind == "nan":
        state["bn1.bias"] = torch.full((64,), torch.nan)
    elif kind == "scalar":
        state["fc.weight"] = torch.tensor(1.0)
    elif kind == "text":
        state["bn1.bias"] = "none"
    elif kind == "narrow":
        return MobileFaceNet(8).state_dict()
    elif kind == "list":
        return [1, 2]
    elif kind == "code":
        return Bomb()
    return state


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", r"layer1\.0\.conv1\.weight is missing; give the weights of a ResNet18"),
        ("shape", r"conv1\.weight is \(64, 2, 7, 7\), not \(64, 3, 7, 7\)"),
        ("foreign", r"'layer5\\n\.weight' belongs to another network"),
        ("nan", r"bn1\.bias holds numbers that are not finite"),
        ("scalar", r"fc\.weight is \(\), not \(32, 512\)"),
        ("text", r"bn1\.bias is no plain tensor of numbers"),
        ("narrow", r"and \d+ more differences; give the weights of a ResNet18"),
        ("list", "holds no tensors by name"),
        ("code", "is no readable file of weights"),
    ],
)
def test_other_weights_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    torch.save(spoilt(ResNet18(32).state_dict(), kind), "weights.pth")
    with pytest.raises(InputError, match=message) as error:
        encoder("road", Path("weights.pth"), SETTINGS)
    assert str(error.value).startswith("weights.pth: ")
    assert str(error.value).isprintable()
    assert not Path("exploded").exists()


def test_files_that_hold_no_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        encoder("road", tmp_path / "w", SETTINGS)
    torch.save(ResNet18(32).state_dict(), tmp_path / "w")
    content = (tmp_path / "w").read_bytes()
    for part in (b"", b"weights", content[: len(content) // 2]):
        (tmp_path / "w").write_bytes(part)
        with pytest.raises(InputError, match="is no readable file of weights"):
            encoder("road", tmp_path / "w", SETTINGS)
    torch.save(MobileFaceNet(16).state_dict(), tmp_path / "w")
    with pytest.raises(InputError, match="answers 16 values, fewer than the 64 features"):
        encoder("driver", tmp_path / "w", SETTINGS)
