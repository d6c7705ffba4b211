"""Tensors on disk: written whole or not at all, and read without executing anything."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import TorchCheckpointIO

from isacsim.errors import InputError
from isacsim.files import replace_file
from models.run import DAMAGE


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors and plain values by temporary file and rename. Raises OutputError."""
    # Through memory: torch itself tells of a full disk by an error that does not say so.
    buffer = io.BytesIO()
    torch.save(content, buffer)
    replace_file(path, lambda partial: partial.write_bytes(buffer.getbuffer()))


def read_tensors(path: Path) -> dict[str, Any]:
    """What `write_tensors` wrote. Raises InputError where it is damaged, or holds other objects."""
    try:
        found: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except DAMAGE as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path}: is damaged ({reason}); delete it, and training begins anew") from None
    return found


class Checkpoints(TorchCheckpointIO):
    """How Lightning writes and reads checkpoints; its own way may leave half a file when the command is killed."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        file = Path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_tensors(file, checkpoint)

    def load_checkpoint(
        self, path: str | Path, map_location: Any = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        return read_tensors(Path(path))
