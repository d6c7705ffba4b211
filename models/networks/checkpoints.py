"""The files that a training leaves: tensors written completely or not at all, and read without executing anything."""

from __future__ import annotations

import io
import pickle
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file

HISTORY_FILE = "history.csv"
"""Losses and scores of each epoch, in the folder of a run."""

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
