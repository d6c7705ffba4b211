"""Files and folders that this project writes: whole or not at all, and never over anything else's."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from isacsim.errors import InputError, writing

LOCK_FILE = ".lock"
"""Held open while a command writes a folder; it stays behind, empty."""


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file completely or not at all, also when the machine goes down.

    write: is given a temporary path in the same folder, with the same suffix, and writes the file there.
    Raises OutputError where the file cannot be written.
    """
    partial = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        with writing(path):
            write(partial)
            # Renaming alone does not make sure that the content reaches the disk before the name does.
            with partial.open("r+b") as file:
                os.fsync(file.fileno())
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """Write plain values as indented JSON, completely or not at all. Raises OutputError."""
    replace_file(path, lambda partial: partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8"))


def remove_partial(folder: Path, pattern: str) -> None:
    """Delete what commands that were killed while writing files of that pattern left behind in a folder."""
    for partial in folder.glob(f".*-{pattern}"):
        partial.unlink()


@contextmanager
def claim(folder: Path, mark: str, kind: str) -> Iterator[None]:
    """Hold a folder of results against every other command, and make it where it does not exist.

    mark: name of the file that shows that the folder is of this kind; the caller writes it first of all.
    kind: what the folder is for, "dataset". The hold ends with the process, however it ends.
    Raises InputError where the folder is a file, holds something else, cannot be used, or is held by another command.
    """
    lock = FileLock(folder / LOCK_FILE, timeout=0)
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; give a folder for the {kind}")
        if folder.is_dir() and not _is_ours(folder, mark):
            raise InputError(f"{folder}: is not empty and holds no {kind}; choose a new or empty folder")
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: another command is writing it; wait for it, or choose another folder") from None
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror}); choose another folder for the {kind}"
        ) from None
    try:
        yield
    finally:
        lock.release()


def _is_ours(folder: Path, mark: str) -> bool:
    """Return whether a folder is empty, has its mark, or was left by a command killed before the mark was written."""
    return (folder / mark).is_file() or all(
        path.name == LOCK_FILE or (path.name.startswith(".") and path.name.endswith(f"-{mark}"))
        for path in folder.iterdir()
    )
