"""How errors of the operating system are reported."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from isac_cosim.base.errors import NO_ROOM, WRONG_PATH, OutputError, writing


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "table.csv"
    with pytest.raises(OutputError) as error, writing(path):
        path.write_text("x")
    reason = "cannot be written (No such file or directory); fix that, and the same command goes on from there"
    assert str(error.value) == f"{path}: {reason}"


def test_the_numbers_are_those_of_this_platform() -> None:
    assert {errno.ENOSPC, errno.EROFS} <= set(NO_ROOM)
    assert {errno.EACCES, errno.EISDIR, errno.ENOTDIR} <= set(WRONG_PATH)
    assert not set(NO_ROOM) & set(WRONG_PATH)
