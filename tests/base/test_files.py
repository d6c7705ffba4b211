"""Files written whole or not at all, and folders held by one command."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base import files
from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.base.files import (
    LOCK_FILE,
    claim,
    file_digest,
    json_text,
    remove_partial,
    replace_file,
    write_json,
)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("before")

    def fail(partial: Path) -> None:
        assert partial.suffix == ".csv"
        partial.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match=r"table\.csv: cannot be written \(No space left on device\)"):
        replace_file(path, fail)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    replace_file(path, lambda partial: partial.write_text("after"))
    assert path.read_text() == "after"


@given(
    st.recursive(
        st.floats() | st.integers() | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)
    )
)
def test_a_json_file_has_only_what_json_knows(content: object) -> None:
    """NaN and infinity become null; every other value comes back."""

    def refuse(name: str) -> None:
        raise AssertionError(name)

    text = json_text(content)
    assert json_text(json.loads(text, parse_constant=refuse)) == text


def test_what_killed_commands_left_is_removed(tmp_path: Path) -> None:
    kept = [tmp_path / "a.json", tmp_path / ".4711-a.parquet"]
    for path in (*kept, tmp_path / ".4711-a.json"):
        path.touch()
    remove_partial(tmp_path, "*.json")
    assert sorted(tmp_path.iterdir()) == sorted(kept)


@pytest.mark.parametrize("content", [(), (LOCK_FILE,), (".4711-run.json",), ("run.json", "notes.txt")])
def test_a_folder_of_this_kind_is_held(tmp_path: Path, content: tuple[str, ...]) -> None:
    for name in content:
        (tmp_path / name).write_text("{}")
    with claim(tmp_path, "run.json", "run"):
        write_json(tmp_path / "run.json", {})
        with pytest.raises(InputError, match="another command is writing it"), claim(tmp_path, "run.json", "run"):
            raise AssertionError("held twice")
    with claim(tmp_path, "run.json", "run"):
        pass


def test_no_lock_is_left(tmp_path: Path) -> None:
    """Neither by a command that ends, nor by one that fails."""
    with claim(tmp_path / "done", "run.json", "run"):
        assert (tmp_path / "done" / LOCK_FILE).is_file()
    with pytest.raises(RuntimeError), claim(tmp_path / "failed", "run.json", "run"):
        raise RuntimeError
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def count_up(folder: Path, times: int) -> None:
    """Add to a number in a folder, as often as the folder can be had."""
    number = folder / "run.json"
    while times:
        with suppress(InputError), claim(folder, "run.json", "run"):
            number.write_text(str(int(number.read_text()) + 1))
            times -= 1


def test_a_folder_is_never_held_twice_although_the_lock_is_deleted(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("0")
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=count_up, args=(tmp_path, 200)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert (tmp_path / "run.json").read_text() == "600"


@pytest.mark.parametrize("content", ["notes.txt", ".run.json", "4711-run.json"])
def test_a_folder_of_something_else_is_refused_untouched(tmp_path: Path, content: str) -> None:
    (tmp_path / content).write_text("mine")
    with pytest.raises(InputError, match="is not empty and holds no run"), claim(tmp_path, "run.json", "run"):
        raise AssertionError("claimed")
    assert [path.name for path in tmp_path.iterdir()] == [content]


def test_a_mark_that_is_a_folder_is_no_mark(tmp_path: Path) -> None:
    (tmp_path / "run.json").mkdir()
    with pytest.raises(InputError, match="holds no run"), claim(tmp_path, "run.json", "run"):
        raise AssertionError("claimed")


def test_a_file_is_refused_as_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is a file; give a folder for the run"), claim(tmp_path / "file", "x", "run"):
        raise AssertionError("claimed")
    with pytest.raises(InputError, match="cannot be written"), claim(tmp_path / "file" / "run", "x", "run"):
        raise AssertionError("claimed")


def test_a_digest_is_that_of_the_bytes_however_often_the_file_changes(tmp_path: Path) -> None:
    """Also right after a change, which the file's times may not show."""
    path = tmp_path / "file"
    for number in range(50):
        content = bytes([number]) * 1000
        path.write_bytes(content)
        assert file_digest(path) == hashlib.sha256(content).hexdigest()


def test_a_file_that_has_settled_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"content")
    monkeypatch.setattr(files, "SETTLED_S", -1.0)
    digest = file_digest(path)
    monkeypatch.setattr(files, "_digest_of", None)
    assert file_digest(path) == digest
