"""The errors that the command line shows as one line, and how errors of the operating system become one of them."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def _numbers(*names: str) -> tuple[int, ...]:
    """Return the numbers of those error names that this platform has."""
    return tuple(getattr(errno, name) for name in names if hasattr(errno, name))


NO_SPACE = _numbers("ENOSPC", "EDQUOT", "EFBIG")
"""Numbers of the operating system's errors that say that a disk is full, or a file as large as it may be."""
NO_ROOM = (*NO_SPACE, *_numbers("EROFS"))
"""Numbers of the operating system's errors that say that a disk takes no more data."""
NO_FILES = _numbers("EMFILE", "ENFILE")
"""Numbers of the operating system's errors that say that too many files are open."""
NO_MEMORY = _numbers("ENOMEM")
"""Number of the operating system's error that says that no memory is left."""
WRONG_PATH = _numbers("EACCES", "EISDIR", "ELOOP", "ENAMETOOLONG", "ENOTDIR", "EPERM")
"""Numbers of the operating system's errors that say that a path is invalid or may not be used."""


class InputError(Exception):
    """The input or the arguments are wrong.

    The message is one line: what is wrong, where, and how to fix it. The command line prints it and exits with 2.
    """


class RunError(RuntimeError):
    """The input is right, but the work could not be done.

    The message is one line: what failed, where, and how to fix it if that is known. The command line prints it and
    exits with 1.
    """


class OutputError(RunError):
    """A file could not be written: the disk is full, or the folder is read-only or gone. A retry does not help."""


class ShortageError(RunError):
    """The machine has no more memory, or may not open more files. The work itself is right, and can be repeated."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an error of the operating system inside the block into an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from None


def output_error(path: object, error: OSError) -> OutputError:
    """Return the error to raise for a file that cannot be written."""
    reason = error.strerror or str(error)
    return OutputError(f"{path}: cannot be written ({reason}); fix that, and the same command goes on from there")
