"""The networks that turn pictures into features, with weights that the user has, or else random ones.

Published ResNet-18 and MobileFaceNet answer in other widths than the paper's 32 and 64. Features of another width are
projected by a random matrix with orthonormal columns, drawn from the seed: it keeps distances as well as one can that
was not trained. Weights whose last layer has the paper's width are used as they are.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import shortened
from isac_cosim.base.seeding import stream
from isac_cosim.base.stored.archives import check_archive
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of
from isac_cosim.models.data.clips import View
from isac_cosim.models.video.face_network import MobileFaceNet
from isac_cosim.models.video.resnet import ResNet18
from isac_cosim.models.video.settings import VideoSettings

VIEWS: tuple[View, ...] = ("road", "driver")
NETWORKS: dict[View, tuple[Callable[[int], ResNet18 | MobileFaceNet], str]] = {
    "road": (ResNet18, "fc.weight"),
    "driver": (MobileFaceNet, "linear.weight"),
}
"""The network of each view, and its last weights, whose rows are as many as it has values in its answer."""
COUNTER = "num_batches_tracked"
"""Ends the names of values that count batches of training, which older files lack and no answer depends on."""
NESTED, PREFIX = "state_dict", "module."
"""Training programs store weights under this key, and under names that begin so when trained on several devices."""
MOST_FILE_BYTES = 2_000_000_000
MOST_WIDTH = 100_000
BATCH = 25
"""Pictures that a network gets at once."""


@dataclass(frozen=True)
class Encoder:
    """A network with all its weights. projection: (F, width), applied to its features; None for its own answer."""

    network: ResNet18 | MobileFaceNet
    projection: Tensor | None

    @torch.inference_mode()
    def __call__(self, pictures: Float32Array) -> Float32Array:
        """Return the features of pictures (n, 3, H, W), one row each."""
        parts = []
        for start in range(0, len(pictures), BATCH):
            part = torch.from_numpy(pictures[start : start + BATCH])
            answer = self.network(part) if self.projection is None else self.network.features(part) @ self.projection
            parts.append(answer.numpy())
        return np.concatenate(parts).astype(np.float32)


def encoder(view: View, weights: Path | None, settings: VideoSettings) -> Encoder:
    """Return the encoder of a view. weights: file of its network's state dict; None for random weights.

    Raises InputError where the file is damaged or holds another network.
    """
    width = settings.road_width if view == "road" else settings.driver_width
    build, last = NETWORKS[view]
    if weights is None:
        return Encoder(_random(build, width, settings.seed, view).eval(), None)
    state = _state(weights)
    rows = state[last].shape[0] if isinstance(state.get(last), Tensor) and state[last].ndim else width
    if not 1 <= rows <= MOST_WIDTH:
        raise InputError(f"{weights}: {last} has {rows} rows; give the weights of a {build.__name__}")
    with torch.device("meta"):
        expected = build(rows).state_dict()
    _check(weights, state, expected, build.__name__)
    network = build(rows)
    network.load_state_dict({name: state[name] for name in state if not name.endswith(COUNTER)}, strict=False)
    if rows == width:
        return Encoder(network.eval(), None)
    inner = rows if view == "driver" else state[last].shape[1]
    if inner < width:
        raise InputError(f"{weights}: answers {inner} values, fewer than the {width} features that are wanted")
    return Encoder(network.eval(), projection(inner, width, settings.seed, view))


def projection(inner: int, width: int, seed: int, view: View) -> Tensor:
    """Return a random matrix with orthonormal columns, (inner, width)."""
    drawn = stream("clips", "projection", view, seed).standard_normal((inner, width))
    return torch.from_numpy(np.linalg.qr(drawn)[0].astype(np.float32))


def _random(
    build: Callable[[int], ResNet18 | MobileFaceNet], width: int, seed: int, view: View
) -> ResNet18 | MobileFaceNet:
    """Return a network with random weights that keep the size of what passes. Source: He et al., ICCV 2015."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(stream("clips", "weights", view, seed).integers(2**62)))
        network = build(width)
        for layer in network.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
    return network


def _state(path: Path) -> dict[str, Any]:
    """Return the tensors in a file by name, as PyTorch writes them, also before version 1.6."""
    try:
        if path.stat().st_size > MOST_FILE_BYTES:
            raise ValueError(f"has more than {MOST_FILE_BYTES} bytes")
        if zipfile.is_zipfile(path):
            check_archive(path, checksums=True)
        content = torch.load(path, map_location="cpu", weights_only=True)
        content = content.get(NESTED, content) if isinstance(content, dict) else content
        if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
            raise ValueError("holds no tensors by name")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give the weights of the network, or leave the option out") from None
    except READ_ERRORS as error:
        raise InputError(f"{path}: is no readable file of weights ({reason_of(error)}); give a state dict") from None
    return {name.removeprefix(PREFIX): value for name, value in content.items()}


def _check(path: Path, state: dict[str, Any], expected: dict[str, Tensor], network: str) -> None:
    """Raise InputError unless tensors have the names and shapes of a network's, and are finite."""
    wanted = {name for name in expected if not name.endswith(COUNTER)}
    found = {name for name in state if not name.endswith(COUNTER)}
    faults = [f"{name} is missing" for name in sorted(wanted - found)]
    faults += [f"{shortened(name)} belongs to another network" for name in sorted(found - wanted)]
    for name in sorted(wanted & found):
        value, shape = state[name], tuple(expected[name].shape)
        if not isinstance(value, Tensor) or value.layout != torch.strided or not value.is_floating_point():
            faults.append(f"{name} is no plain tensor of numbers")
        elif tuple(value.shape) != shape:
            faults.append(f"{name} is {tuple(value.shape)}, not {shape}")
        elif not bool(torch.isfinite(value).all()):
            faults.append(f"{name} holds numbers that are not finite")
    if faults:
        more = f", and {len(faults) - 1} more differences" if len(faults) > 1 else ""
        raise InputError(f"{path}: {faults[0]}{more}; give the weights of a {network}")
