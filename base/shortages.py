"""Tells where a failure means that the machine lacks something: memory, room on a disk, or open files.

Nothing is wrong with the work then. It ends the command, and the same command goes on from there.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from isac_cosim.base.errors import (
    NO_FILES,
    NO_MEMORY,
    NO_SPACE,
    InputError,
    OutputError,
    RunError,
    ShortageError,
    output_error,
)
from isac_cosim.base.temporary import is_full, temporary_error, temporary_root

MEMORY_WORDS = re.compile(r"bad_alloc|can(no|')t allocate memory|not enough memory|out of memory", re.IGNORECASE)
"""What C++ libraries say where no memory is left; they have no error of their own for it."""


def shortage(error: BaseException, output: Path | None = None) -> RunError | None:
    """Return what ended something, if nothing can be written or the machine lacks something; otherwise None.

    The error may be of any kind, because readers take what they cannot read for damaged. output: the folder that is
    being written.
    """
    for cause in _causes(error):
        if isinstance(cause, OutputError | ShortageError):
            return cause
        said = "" if isinstance(cause, InputError) else str(cause)
        if isinstance(cause, MemoryError) or MEMORY_WORDS.search(said):
            return no_memory(str(cause))
        if isinstance(cause, OSError) and (lacking := _lacking(cause, output)) is not None:
            return lacking
    return None


def hidden_shortage() -> RunError | None:
    """Return what may have ended a simulation: SUMO does not say why it could not write."""
    return temporary_error("no space left") if is_full(temporary_root()) else None


def no_memory(reason: str) -> ShortageError:
    """Return the error to raise where no memory is left."""
    told = f" ({' '.join(reason.split())[:200]})" if reason.strip() else ""
    return ShortageError(
        f"no memory is left{told}; give fewer --jobs or a machine with more memory, and the same command goes on from "
        "there"
    )


def _lacking(error: OSError, output: Path | None) -> RunError | None:
    """Return what the operating system lacks, None where its error says something else."""
    if error.errno in NO_MEMORY:
        return no_memory(str(error))
    if error.errno in NO_FILES:
        return ShortageError(
            f"too many files are open ({error.strerror}); raise the limit (`ulimit -n`), or give fewer --jobs, and the "
            "same command goes on from there"
        )
    if error.errno not in NO_SPACE:
        return None
    reason = error.strerror or str(error)
    if error.filename is not None:
        within = Path(os.fsdecode(error.filename)).is_relative_to(tempfile.gettempdir())
        return temporary_error(reason) if within else output_error(error.filename, error)
    # Writing to a file that is open does not tell which one that was.
    if output is not None and is_full(output) and not is_full(temporary_root()):
        return output_error(output, error)
    return temporary_error(reason)


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and those that led to it, the latest first."""
    cause: BaseException | None = error
    seen: list[BaseException] = []
    while cause is not None and cause not in seen:
        seen.append(cause)
        yield cause
        cause = cause.__cause__ or cause.__context__
