"""Whether the machine lacks something: found in the error itself, or in one that led to it, and named."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

import pytest

from isac_cosim.base import shortages
from isac_cosim.base.errors import InputError, OutputError, RunError, ShortageError
from isac_cosim.base.shortages import hidden_shortage, shortage


def failed(number: int, file: str | None = None) -> OSError:
    return OSError(number, os.strerror(number), *([file] if file else []))


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (MemoryError(), ShortageError, "no memory is left"),
        (failed(errno.ENOMEM), ShortageError, "no memory is left"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), ShortageError, "no memory is left"),
        (RuntimeError("CUDA out of memory."), ShortageError, "no memory is left"),
        (failed(errno.EMFILE), ShortageError, "too many files are open"),
        (failed(errno.ENFILE), ShortageError, "too many files are open"),
        (failed(errno.ENOSPC, "/data/out/x"), OutputError, "/data/out/x: cannot be written"),
        (failed(errno.EDQUOT, "/data/out/x"), OutputError, "/data/out/x: cannot be written"),
        (failed(errno.ENOSPC), OutputError, "the folder for temporary files cannot be written"),
        (failed(errno.EFBIG), OutputError, "the folder for temporary files cannot be written"),
    ],
)
def test_what_is_lacking_is_named(error: Exception, kind: type[RunError], words: str) -> None:
    found = shortage(error)
    assert type(found) is kind
    assert str(found).startswith(words)
    assert "\n" not in str(found)


@pytest.mark.parametrize(
    "error",
    [
        failed(errno.ENOENT, "x"),
        failed(errno.EACCES, "x"),
        ValueError("no number"),
        RunError("SUMO failed"),
        InputError("out of memory.net.xml: does not exist"),
    ],
)
def test_other_errors_are_no_shortage(error: Exception) -> None:
    assert shortage(error) is None


def test_a_shortage_that_a_reader_took_for_damage_is_found() -> None:
    def read() -> None:
        try:
            raise failed(errno.EMFILE, "weights.pt")
        except OSError:
            raise InputError("weights.pt: is damaged; delete it") from None

    with pytest.raises(InputError) as caught:
        read()
    assert isinstance(shortage(caught.value), ShortageError)


def test_a_file_among_the_temporary_ones_is_not_called_output() -> None:
    file = str(Path(tempfile.gettempdir()) / "cosim-x" / "states")
    assert str(shortage(failed(errno.ENOSPC, file))).startswith("the folder for temporary files")


def test_of_two_disks_the_full_one_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full: list[Path] = []
    monkeypatch.setattr(shortages, "is_full", lambda folder: folder in full)
    error = failed(errno.ENOSPC)
    assert str(shortage(error, tmp_path)).startswith("the folder for temporary files")
    full.append(tmp_path)
    assert str(shortage(error, tmp_path)).startswith(f"{tmp_path}: cannot be written")


def test_a_full_folder_explains_what_sumo_does_not_say(monkeypatch: pytest.MonkeyPatch) -> None:
    assert hidden_shortage() is None
    monkeypatch.setattr(shortages, "is_full", lambda folder: True)
    assert isinstance(hidden_shortage(), OutputError)
