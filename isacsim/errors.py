"""The errors that reach the command line as one line, and the ways they come about."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""What the operating system says of a disk that takes no more."""
WRONG_PATH = (errno.EACCES, errno.EISDIR, errno.ELOOP, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EPERM)
"""What it says of a path that is none, or that may not be used."""


class InputError(Exception):
    """The input or the arguments are wrong.

    The message is one line: what is wrong, where, and the mend. The command line prints it and exits with 2.
    """


class RunError(RuntimeError):
    """The input is right, but what was asked could not be done.

    The message is one line: what failed, where, and the mend if there is one. The command line prints it and exits
    with 1.
    """


class OutputError(RunError):
    """A file could not be written: the disk is full, or the folder is read-only or gone. Trying again mends nothing."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns an error of the operating system, on writing a file, into an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from None


def output_error(path: object, error: OSError) -> OutputError:
    """What is said of a file that cannot be written."""
    why = error.strerror or str(error)
    return OutputError(f"{path}: cannot be written ({why}); mend that, and the same command goes on from there")
