"""Folders for temporary files: deleted at the end, or by the next command of the same user where this one is killed.

A folder is locked while it is in use, and the lock ends with its process, however that ends. The number of the process
would not do: another process may have it by then, and containers that share such folders count their processes apart.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Self

from filelock import BaseFileLock, FileLock, Timeout

from isac_cosim.base.errors import OutputError

PREFIX = "cosim-"
LOCK_FILE = ".lock"
VARIABLES = ("TMPDIR", "TEMP", "TMP")
"""Environment variables that say where temporary files go."""
LITTLE_ROOM = 2**16
"""A disk with fewer free bytes than this is full."""
_told: list[Path] = []
"""What messages call the folder of this process's temporary files, if that is not its own name."""


class TemporaryFolder:
    """A new folder for temporary files, which is deleted with this object, by `remove`, or at the end of a block.

    within: the folder that it lies in, by default that of all temporary files. Raises OutputError where it cannot be
    made.
    """

    def __init__(self, within: Path | None = None) -> None:
        with writing_temporary():
            parent = Path(tempfile.gettempdir()) if within is None else within
            _remove_abandoned(parent)
            self.path, lock = _new_folder(parent)
        self._remove = weakref.finalize(self, _remove, self.path, lock)

    def remove(self) -> None:
        """Delete the folder, unless that is done already."""
        self._remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()


def keep_temporary_files_in(folder: Path, told: Path) -> None:
    """Let this process and its libraries write their temporary files into a folder of its own.

    told: the folder that messages name instead, the one that the user knows.
    """
    tempfile.tempdir = str(folder)
    os.environ.update(dict.fromkeys(VARIABLES, str(folder)))
    _told[:] = [told]


def temporary_root() -> Path:
    """Return the folder for temporary files that the user knows."""
    return _told[0] if _told else Path(tempfile.gettempdir())


@contextmanager
def writing_temporary() -> Iterator[None]:
    """Turn an error of the operating system inside the block into an OutputError that names the temporary folder."""
    try:
        yield
    except OSError as error:
        raise temporary_error(error.strerror or str(error)) from None


def temporary_error(reason: str) -> OutputError:
    """Return the error to raise where temporary files cannot be written."""
    # Where there is no such folder at all, the search for one fails again.
    with suppress(OSError):
        reason = f"{temporary_root()}: {reason}"
    return OutputError(
        f"the folder for temporary files cannot be written ({reason}); make room there, or set TMPDIR to a folder with "
        "room, and the same command goes on from there"
    )


def is_full(folder: Path) -> bool:
    """Return whether the disk of a folder has no room left."""
    try:
        return shutil.disk_usage(folder).free < LITTLE_ROOM
    except OSError:
        return False


def _new_folder(parent: Path) -> tuple[Path, BaseFileLock]:
    """Return a new folder and its lock, which is held."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        lock = FileLock(folder / LOCK_FILE, timeout=0, thread_local=False)
        # Another command may take the folder for an abandoned one as long as it is not locked.
        with suppress(Timeout, FileNotFoundError):
            lock.acquire()
            if folder.is_dir():
                return folder, lock


def _remove(folder: Path, lock: BaseFileLock) -> None:
    # In this order, because Windows does not delete a file that is open.
    lock.release()
    shutil.rmtree(folder, ignore_errors=True)


@lru_cache(maxsize=8)
def _remove_abandoned(parent: Path) -> None:
    """Delete this user's temporary folders that no process uses any more; only the first call does anything."""
    for folder in parent.glob(f"{PREFIX}*"):
        if not _is_own(folder) or not (folder / LOCK_FILE).is_file():
            continue
        lock = FileLock(folder / LOCK_FILE, timeout=0, thread_local=False)
        with suppress(Timeout, OSError):
            lock.acquire()
            _remove(folder, lock)


def _is_own(folder: Path) -> bool:
    """Return whether a path is a folder, and no link to one, that belongs to this user."""
    with suppress(OSError):
        return (
            folder.is_dir()
            and not folder.is_symlink()
            and (not hasattr(os, "geteuid") or folder.lstat().st_uid == os.geteuid())
        )
    return False
