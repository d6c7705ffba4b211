"""Folders for temporary files: deleted in the end, whoever deletes them, and never while they are in use."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import cosim
from isac_cosim.base import temporary
from isac_cosim.base.errors import OutputError
from isac_cosim.base.temporary import LOCK_FILE, PREFIX, TemporaryFolder, writing_temporary

ROOT = Path(cosim.__file__).parent
HOLD = """
import sys
from isac_cosim.base.temporary import TemporaryFolder

with TemporaryFolder() as folder:
    (folder.path / "states").write_text("x")
    print(folder.path, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    temporary._remove_abandoned.cache_clear()
    return tmp_path


def held(parent: Path) -> subprocess.Popen[str]:
    """A process that holds a folder until it is ended, and has it made."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD],
        env={**os.environ, "TMPDIR": str(parent)},
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert Path(process.stdout.readline().strip()).parent == parent
    return process


def test_a_folder_ends_with_its_block_or_its_object(parent: Path) -> None:
    with TemporaryFolder() as folder:
        (folder.path / "inside").mkdir()
        assert folder.path.parent == parent
    assert not folder.path.exists()
    kept = TemporaryFolder()
    path = kept.path
    assert path.is_dir()
    del kept
    assert not path.exists()


def test_what_a_killed_process_left_is_deleted_by_the_next_and_what_is_in_use_is_not(parent: Path) -> None:
    abandoned, used = held(parent), held(parent)
    folders = set(parent.glob(f"{PREFIX}*"))
    assert len(folders) == 2
    abandoned.kill()
    abandoned.communicate()
    with TemporaryFolder() as own:
        left = {path for path in parent.glob(f"{PREFIX}*") if path != own.path}
    assert len(left) == 1
    assert left < folders
    assert (left.pop() / "states").read_text() == "x"
    used.communicate("")
    assert list(parent.glob(f"{PREFIX}*")) == []


def test_the_rest_of_the_folder_is_left_alone(parent: Path) -> None:
    """Folders of others, of earlier versions, which had no lock, and links to folders elsewhere."""
    mine = parent / "mine"
    mine.mkdir()
    (mine / LOCK_FILE).touch()
    (parent / f"{PREFIX}link").symlink_to(mine)
    (parent / f"{PREFIX}earlier").mkdir()
    (parent / f"{PREFIX}file").write_text("x")
    (parent / "other").mkdir()
    (parent / "other" / LOCK_FILE).touch()
    before = sorted(parent.rglob("*"))
    with TemporaryFolder():
        pass
    assert sorted(parent.rglob("*")) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="giving a folder away takes root")
def test_a_folder_of_another_user_is_left_alone(parent: Path) -> None:
    folder = parent / f"{PREFIX}others"
    folder.mkdir()
    (folder / LOCK_FILE).touch()
    os.chown(folder, 65534, 65534)
    with TemporaryFolder():
        pass
    assert folder.is_dir()


def test_a_folder_that_cannot_be_made_names_where(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(parent / "missing"))
    with pytest.raises(OutputError, match=rf"temporary files cannot be written \({parent}/missing: No such file"):
        TemporaryFolder()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")
def test_a_full_disk_names_the_folder(parent: Path) -> None:
    with pytest.raises(OutputError, match=rf"{parent}: No space left on device.*set TMPDIR"), writing_temporary():
        Path("/dev/full").write_text("x")
