"""A file that appears or changes beside a scenario's files is noticed; what was there before is not."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.folder_watch import SMALL_BYTES, unchanged


def keeping_the_time(file: Path, write: Callable[[Path], object]) -> None:
    state = file.stat()
    write(file)
    os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))


CHANGES: dict[str, Callable[[Path], object]] = {
    "new": lambda folder: (folder / "changed").write_text("x"),
    "longer": lambda folder: (folder / "changed.xml").write_text("longer than before"),
    "same length and time": lambda folder: keeping_the_time(
        folder / "changed.xml", lambda file: file.write_text("yyyyy")
    ),
    "large": lambda folder: (folder / "changed.big").write_bytes(b"y" * (SMALL_BYTES + 1)),
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    folder = tmp_path / "road"
    folder.mkdir()
    (folder / "changed.xml").write_text("xxxxx")
    (folder / "changed.big").write_bytes(b"x" * (SMALL_BYTES + 1))
    (folder / "a.net.xml").write_text("<net/>")
    return folder / "a.net.xml"


def watched(file: Path, task: Callable[[], object]) -> None:
    with unchanged("road", [file]):
        task()


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_named(file: Path, change: str) -> None:
    with pytest.raises(InputError, match=r"changed\S* changed while SUMO simulated road: remove") as caught:
        watched(file, lambda: CHANGES[change](file.parent))
    assert "\n" not in str(caught.value)


def test_a_change_is_named_also_where_sumo_fails(file: Path) -> None:
    def fail() -> None:
        CHANGES["new"](file.parent)
        raise RuntimeError

    with pytest.raises(InputError, match="changed while SUMO simulated road"):
        watched(file, fail)


def test_reading_folders_and_removing_are_no_changes(file: Path) -> None:
    (file.parent / "results").mkdir()
    with unchanged("road", [file, file]):
        file.read_text()
        (file.parent / "more").mkdir()
        (file.parent / "results" / "shard").write_text("x")
        (file.parent / "changed.xml").unlink()
    with pytest.raises(RuntimeError), unchanged("road", [file]):
        raise RuntimeError
