"""A confined task writes in its own folder and nowhere else, and is otherwise as any other."""

from __future__ import annotations

import contextvars
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.base.landlock import confined

pytestmark = pytest.mark.skipif(not landlock.version(), reason="the kernel has no Landlock")


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    return tmp_path


CHANGES: dict[str, Callable[[Path], object]] = {
    "create": lambda folder: (folder / "new").write_text("x"),
    "overwrite": lambda folder: (folder / "file").write_text("x"),
    "append": lambda folder: (folder / "file").open("a"),
    "truncate": lambda folder: os.truncate(folder / "file", 0),
    "remove": lambda folder: (folder / "file").unlink(),
    "rename": lambda folder: (folder / "file").rename(folder / "other"),
    "move away": lambda folder: (folder / "file").rename(landlock_folder() / "file"),
    "link": lambda folder: (folder / "link").hardlink_to(folder / "file"),
    "symbolic link": lambda folder: (folder / "link").symlink_to(folder / "file"),
    "make a folder": lambda folder: (folder / "new").mkdir(),
    "remove a folder": lambda folder: (folder / "folder").rmdir(),
    "pipe": lambda folder: os.mkfifo(folder / "pipe"),
    "by a child": lambda folder: subprocess.run(["touch", folder / "new"], check=True, capture_output=True),
    "by another thread": lambda folder: in_thread(lambda: (folder / "new").write_text("x")),
    "through a link of its own": lambda folder: through_link(folder),
}


def landlock_folder() -> Path:
    folder = landlock.folder()
    assert folder is not None
    return folder


def in_thread(task: Callable[[], object]) -> None:
    errors: list[Exception] = []

    def run() -> None:
        try:
            task()
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    for error in errors:
        raise error


def through_link(folder: Path) -> None:
    (landlock_folder() / "link").symlink_to(folder)
    (landlock_folder() / "link" / "new").write_text("x")


@pytest.mark.parametrize("change", CHANGES)
def test_nothing_elsewhere_is_changed(victim: Path, change: str) -> None:
    """The same change is possible before and afterwards."""
    before = {path: path.read_text() if path.is_file() else None for path in victim.rglob("*")}
    with pytest.raises((OSError, subprocess.CalledProcessError)):
        confined(lambda: CHANGES[change](victim))
    assert {path: path.read_text() if path.is_file() else None for path in victim.rglob("*")} == before
    if "own" not in change and "away" not in change:
        CHANGES[change](victim)


def test_the_folder_of_its_own_takes_everything_and_is_removed() -> None:
    def task() -> tuple[Path, str]:
        folder = landlock_folder()
        with tempfile.TemporaryDirectory(dir=folder) as name:
            (Path(name) / "a").write_text("x")
            (Path(name) / "a").rename(folder / "b")
        with Path(os.devnull).open("w") as nowhere:
            nowhere.write("x")
        return folder, (folder / "b").read_text()

    folder, text = confined(task)
    assert text == "x"
    assert not folder.exists()
    assert landlock.folder() is None


def test_what_is_outside_can_be_read_and_files_that_are_open_stay_so(victim: Path) -> None:
    with (victim / "file").open("a") as file:
        assert confined(lambda: ((victim / "file").read_text(), file.write("new"))) == ("old", 3)
    assert (victim / "file").read_text() == "oldnew"


@pytest.mark.skipif(landlock.version() < 4, reason="the kernel's Landlock does not cover TCP")
def test_no_connection_is_opened() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        with pytest.raises(PermissionError):
            confined(lambda: socket.create_connection(address, timeout=5))
        socket.create_connection(address, timeout=5).close()


def test_results_errors_and_context_are_those_of_the_task() -> None:
    variable: contextvars.ContextVar[int] = contextvars.ContextVar("variable", default=0)
    variable.set(7)
    assert confined(variable.get) == 7
    with pytest.raises(InputError, match="wrong"):
        confined(lambda: _raise(InputError("wrong")))
    with pytest.raises(SystemExit):
        confined(lambda: _raise(SystemExit(3)))


def _raise(error: BaseException) -> None:
    raise error


def test_within_a_confined_task_another_has_the_same_folder() -> None:
    assert confined(lambda: (landlock.folder(), confined(landlock.folder)))[1:] != (None,)
    outer, inner = confined(lambda: (landlock.folder(), confined(landlock.folder)))
    assert outer == inner


def test_without_landlock_a_task_runs_as_it_is(victim: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landlock, "version", lambda: 0)
    assert confined(threading.current_thread) is threading.current_thread()
    confined(lambda: (victim / "new").write_text("x"))


@pytest.mark.parametrize("offered", range(1, landlock.version() + 1))
def test_older_kernels_protect_what_they_can(victim: Path, offered: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landlock, "version", lambda: offered)
    with pytest.raises(PermissionError):
        confined(lambda: (victim / "new").write_text("x"))
    with pytest.raises(PermissionError):
        confined((victim / "file").unlink)


def test_an_interrupt_ends_the_task_and_removes_its_folder(tmp_path: Path) -> None:
    """Ctrl-C reaches the main thread, which waits."""
    code = (
        "import os, time\n"
        "from isac_cosim.base import landlock\n"
        "def task():\n"
        "    try:\n"
        "        print(landlock.folder(), flush=True)\n"
        "        while True:\n"
        "            time.sleep(0.01)\n"
        "    finally:\n"
        "        print('ended', flush=True)\n"
        "landlock.confined(task)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert process.stdout is not None
    folder = Path(process.stdout.readline().strip())
    assert folder.is_dir()
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=60)
    assert printed == "ended\n"
    assert "KeyboardInterrupt" in errors
    assert process.returncode != 0
    assert not folder.exists()
