"""Writes files completely or not at all, only into folders that belong to this project, and tells if one changed."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from math import isfinite
from pathlib import Path
from reprlib import Repr
from typing import Any

from filelock import BaseFileLock, FileLock, Timeout

from isac_cosim.base.errors import InputError, writing

LOCK_FILE = ".lock"
"""Name of the file that is locked while a command writes a folder. The command deletes it at its end."""
DIGEST = r"^[0-9a-f]{64}$"
"""A SHA-256 digest, hexadecimal."""
SHORT = Repr()
"""Describes texts by at most 40 characters."""
SHORT.maxstring = 40
SETTLED_S = 2.0
"""A file that was changed more recently may change again without a change of its times, s."""


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file completely or not at all, even if the machine goes down meanwhile.

    write: called with a temporary path in the same folder and with the same suffix; writes the content there.
    Raises OutputError if the file cannot be written.
    """
    partial = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        with writing(path):
            write(partial)
            # Renaming alone does not guarantee that the content reaches the disk before the name does.
            with partial.open("r+b") as file:
                os.fsync(file.fileno())
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out`, which becomes it if all goes well, and is removed otherwise.

    Raises InputError where `out` exists already, unless it is an empty folder.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} exists and is not an empty folder: give another folder with -o")
    out.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        yield folder
        if out.exists():  # it may be the current folder, which cannot be replaced
            for file in sorted(folder.iterdir()):
                file.rename(out / file.name)
        else:
            folder.chmod(0o755)
            folder.rename(out)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_json(path: Path, content: Any) -> None:
    """Write plain values as indented JSON, completely or not at all. Raises OutputError."""
    replace_file(path, lambda partial: partial.write_text(json_text(content, 1) + "\n", encoding="utf-8"))


def json_text(content: Any, indent: int | None = None) -> str:
    """Return plain values as JSON, in one line if there is no indent.

    JSON has no NaN and no infinity: a number that is not finite is written as null, like all that is undefined.

    >>> json_text({"ratio": float("inf"), "scores": (0.5, float("nan"))})
    '{"ratio": null, "scores": [0.5, null]}'
    """
    return json.dumps(_finite(content), indent=indent, allow_nan=False)


def _finite(content: Any) -> Any:
    if isinstance(content, float) and not isfinite(content):
        return None
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content


def file_digest(path: Path) -> str:
    """Return the SHA-256 digest of a file, hexadecimal. A file that has not changed is read only once."""
    state = path.stat()
    if time.time() - max(state.st_mtime, state.st_ctime) < SETTLED_S:
        return _digest_of(path)
    marks = (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
    return _settled_digest(path, marks)


@lru_cache(maxsize=2**16)
def _settled_digest(path: Path, marks: tuple[int, ...]) -> str:
    """Return a file's digest, which is kept as long as the marks of its state stay the same."""
    return _digest_of(path)


def _digest_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digests_of(files: Iterable[Path]) -> dict[str, str]:
    """Return the SHA-256 digest of each file, by its path from the folder that all of them lie in.

    Raises InputError if a file cannot be read.
    """
    whole = [Path(os.path.abspath(path)) for path in files]
    common = os.path.commonpath([path.parent for path in whole]) if whole else ""
    try:
        return {path.relative_to(common).as_posix(): file_digest(path) for path in whole}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror}); make it readable") from None


def shortened(path: object) -> str:
    """Return a path or name in quotes, its middle left out where it is long, for a description in one line."""
    return SHORT.repr(str(path))


def content_digest(content: Any) -> str:
    """Return the SHA-256 digest of plain values, hexadecimal, whatever the order of their keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def remove_partial(folder: Path, pattern: str) -> None:
    """Delete the temporary files of a folder that belong to killed commands.

    pattern: of the names of the files that those commands were writing, "*.parquet".
    """
    for partial in folder.glob(f".*-{pattern}"):
        partial.unlink()


@contextmanager
def claim(folder: Path, mark: str, kind: str) -> Iterator[None]:
    """Lock a folder of results for this command, and create the folder if it does not exist.

    mark: name of the file that identifies the folder as one of this kind; the caller writes it before anything else.
    kind: what the folder holds, as messages call it, "dataset". The lock ends with the process at the latest.
    Raises InputError if the path is a file, the folder holds something else or cannot be used, or another command has
    locked it.
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
        _let_go(lock, folder / LOCK_FILE)


def _let_go(lock: BaseFileLock, path: Path) -> None:
    """Delete a lock's file, and release the lock.

    In this order, so that nobody else can hold the file that is deleted. Who opened it before that and locks it
    afterwards has locked a file without a name, which filelock notices. Windows deletes no file that is open.
    """
    with suppress(OSError):
        path.unlink()
    lock.release()
    if os.name == "nt":
        with suppress(OSError):
            path.unlink()


def _is_ours(folder: Path, mark: str) -> bool:
    """Return whether a folder has its mark, or is empty apart from the remains of a command that had yet to mark it."""
    return (folder / mark).is_file() or all(
        path.name == LOCK_FILE or (path.name.startswith(".") and path.name.endswith(f"-{mark}"))
        for path in folder.iterdir()
    )
