"""What the readers of files raise where a file is damaged, and how that is told in one line."""

from __future__ import annotations

import pickle
import struct
import tokenize
import zipfile
import zlib

READ_ERRORS = (
    OSError, RuntimeError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, AssertionError,
    EOFError, MemoryError, SyntaxError, pickle.UnpicklingError, struct.error, tokenize.TokenError, zipfile.BadZipFile,
    zlib.error,
)  # fmt: skip
"""What the readers of tensors, trees and arrays raise if a file is cut off or holds something else."""


def reason_of(error: BaseException) -> str:
    """Return what an error says, in one line."""
    return " ".join((str(error) or type(error).__name__).partition("\n")[0].split())
