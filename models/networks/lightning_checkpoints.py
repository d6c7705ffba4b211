"""How Lightning writes and reads checkpoints."""

from __future__ import annotations

import sys
from collections import OrderedDict
from pathlib import Path
from typing import Any

from lightning.fabric.plugins import TorchCheckpointIO

from isac_cosim.base.errors import InputError
from isac_cosim.models.networks.checkpoints import read_tensors, write_tensors

PARTS = ("epoch", "global_step", "state_dict", "loops", "callbacks", "optimizer_states", "lr_schedulers")
"""What a checkpoint holds at least."""
FOLDER = "<folder>"
"""Stands in a checkpoint for the folder that it lies in."""


class Checkpoints(TorchCheckpointIO):
    """How Lightning writes and reads checkpoints; its own writer can leave half a file when the command is killed.

    Lightning's callbacks remember the paths of their files. In a file these are relative to its folder, so the same
    training gives the same bytes in any folder, and a folder that was moved can still be resumed.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        """Write a checkpoint, completely or not at all."""
        file = Path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        callbacks = _with_prefix(checkpoint.get("callbacks", {}), str(file.parent), FOLDER)
        write_tensors(file, _anew({**checkpoint, "callbacks": callbacks}))

    def load_checkpoint(
        self, path: str | Path, map_location: Any = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Read a checkpoint. Raises InputError if it is damaged."""
        checkpoint = read_checkpoint(Path(path))
        # Lightning compares this folder with its own, which it resolves, and forgets the best epoch if they differ.
        callbacks = _with_prefix(checkpoint.get("callbacks", {}), FOLDER, str(Path(path).parent.resolve()))
        return {**checkpoint, "callbacks": callbacks}


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Return the content of a checkpoint. Raises InputError if it is damaged, or lacks one of PARTS."""
    checkpoint = read_tensors(path)
    if lacking := [name for name in PARTS if name not in checkpoint]:
        raise InputError(f"{path}: is damaged ({lacking[0]}: is missing); delete it, and training starts again")
    return checkpoint


def _anew(value: Any) -> Any:
    """Return a value whose containers are new and whose equal texts are one object.

    Pickle writes an object that it has met before as a reference. Without this, a training that was resumed would give
    other bytes than one that was not, since its objects were read from a file.
    """
    if isinstance(value, OrderedDict):
        copied = OrderedDict((_anew(key), _anew(item)) for key, item in value.items())
        vars(copied).update({name: _anew(item) for name, item in vars(value).items()})
        return copied
    if type(value) is dict:
        return {_anew(key): _anew(item) for key, item in value.items()}
    if type(value) in (list, tuple):
        return type(value)(_anew(item) for item in value)
    return sys.intern(value) if type(value) is str else value


def _with_prefix(value: Any, before: str, after: str) -> Any:
    """Return plain values, nested in dictionaries, with a prefix of their texts and keys replaced by another."""
    if isinstance(value, dict):
        return {_with_prefix(key, before, after): _with_prefix(item, before, after) for key, item in value.items()}
    if isinstance(value, str) and (value == before or value.startswith(f"{before}/")):
        return after + value.removeprefix(before)
    return value
