"""The files that a training leaves: tensors written completely or not at all, and read without executing anything."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import nn

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.base.stored.archives import check_archive
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of

Network = TypeVar("Network", bound=nn.Module)

HISTORY_FILE = "history.csv"
"""Losses and scores of each epoch, in the folder of a run."""

SCALES = ("tv_sd", "uv_sd", "sd")
"""Names of the tensors by which networks divide their input."""


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors and plain values, completely or not at all. Raises OutputError."""
    # Through memory, because torch's own error on a full disk does not say that the disk is full.
    buffer = io.BytesIO()
    torch.save(content, buffer)
    replace_file(path, lambda partial: partial.write_bytes(buffer.getbuffer()))


def read_tensors(path: Path) -> dict[str, Any]:
    """Read what `write_tensors` wrote. Raises InputError if the file is damaged or holds other objects."""
    try:
        return _content(path)
    except READ_ERRORS as error:
        raise InputError(f"{path}: is damaged ({reason_of(error)}); delete it, and training starts again") from None


def write_weights(path: Path, network: nn.Module) -> None:
    """Write the weights of a network, completely or not at all. Raises OutputError."""
    write_tensors(path, {name: value.cpu().clone() for name, value in network.state_dict().items()})


def read_weights(path: Path, build: Callable[[], Network]) -> Network:
    """Return a network with the weights in a file.

    build: returns the network with any weights. Before that takes memory, the file has to hold tensors of its shapes.
    Raises one of READ_ERRORS, which names the tensor, if the file is damaged or does not belong to the network.
    """
    state = _content(path)
    try:
        with torch.device("meta"):
            blueprint: nn.Module | None = build()
    except (NotImplementedError, RuntimeError):  # of a package: a network that needs memory to be built
        blueprint = None
    network = None if blueprint is not None else build()
    _check_weights(path.name, state, blueprint or network)
    network = network or build()
    nn.Module.load_state_dict(network, state)
    return network


def _content(path: Path) -> dict[str, Any]:
    """Return the values in a file by name. Raises one of READ_ERRORS."""
    check_archive(path, checksums=True)
    content = torch.load(path, map_location="cpu", weights_only=True)
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise ValueError(f"{path.name}: holds no values by name")
    return content


def _check_weights(file: str, state: dict[str, Any], network: nn.Module | None) -> None:
    """Raise ValueError unless every tensor is one of the network's, of its shape, and can be one of a trained network.

    Scales are positive, and no matrix of weights is zero throughout: such a network answers the same to every window.
    """
    expected = {} if network is None else network.state_dict()
    for name in [*(expected.keys() - state.keys()), *(state.keys() - expected.keys())]:
        raise ValueError(f"{file}: {name}: {'is missing' if name in expected else 'belongs to another network'}")
    for name, wanted in expected.items():
        value = state[name]
        if not isinstance(value, torch.Tensor) or value.layout != torch.strided or value.is_quantized:
            raise ValueError(f"{file}: {name}: is no plain tensor")
        if value.shape != wanted.shape or value.dtype != wanted.dtype:
            found, right = (f"{each.dtype} {tuple(each.shape)}" for each in (value, wanted))
            raise ValueError(f"{file}: {name}: is {found}, not {right}".replace("torch.", ""))
        if value.is_floating_point() and not bool(torch.isfinite(value).all()):
            raise ValueError(f"{file}: {name}: holds numbers that are not finite")
        if name.rpartition(".")[2] in SCALES and bool((value <= 0).any()):
            raise ValueError(f"{file}: {name}: is a scale that is not positive")
        if value.ndim > 1 and "weight" in name.rpartition(".")[2] and not bool(value.any()):
            raise ValueError(f"{file}: {name}: is zero throughout")
