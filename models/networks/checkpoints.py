"""Tensors on disk: written completely or not at all, and read without executing anything."""

from __future__ import annotations

import io
import pickle
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import TorchCheckpointIO

from isacsim.errors import InputError
from isacsim.files import replace_file

READ_ERRORS = (
    OSError, RuntimeError, ValueError, LookupError, TypeError, AttributeError, EOFError, pickle.UnpicklingError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What the readers of tensors, trees and arrays raise if a file is cut off or holds something else."""


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors and plain values, completely or not at all. Raises OutputError."""
    # Through memory, because torch's own error on a full disk does not say that the disk is full.
    buffer = io.BytesIO()
    torch.save(content, buffer)
    replace_file(path, lambda partial: partial.write_bytes(buffer.getbuffer()))


def read_tensors(path: Path) -> dict[str, Any]:
    """Read what `write_tensors` wrote. Raises InputError if the file is damaged or holds other objects."""
    try:
        content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except READ_ERRORS as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path}: is damaged ({reason}); delete it, and training starts again") from None
    return content


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
        write_tensors(file, {**checkpoint, "callbacks": callbacks})

    def load_checkpoint(
        self, path: str | Path, map_location: Any = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Read a checkpoint. Raises InputError if it is damaged."""
        checkpoint = read_tensors(Path(path))
        callbacks = _with_prefix(checkpoint.get("callbacks", {}), FOLDER, str(Path(path).parent))
        return {**checkpoint, "callbacks": callbacks}


def _with_prefix(value: Any, before: str, after: str) -> Any:
    """Return plain values, nested in dictionaries, with a prefix of their texts and keys replaced by another."""
    if isinstance(value, dict):
        return {_with_prefix(key, before, after): _with_prefix(item, before, after) for key, item in value.items()}
    if isinstance(value, str) and (value == before or value.startswith(f"{before}/")):
        return after + value.removeprefix(before)
    return value
