"""Signals that end a command, whether they reach its worker processes too or not: one line, and nothing is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from isac_cosim.base.workers import interrupts
from isac_cosim.labeling.dataset.dataset import read_meta
from isac_cosim.labeling.generation.generate import generate
from tests.support.held_command import started, wait_until_held
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.waiting import HANGING_S, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX")

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
KEPT = "cosim: interrupted; what was finished is kept, and the same command continues from there"


def ended(process: subprocess.Popen[str], number: int, group: bool = True) -> list[str]:
    """Send a signal to the command, or to its whole group; return the lines of standard error. No process is left."""
    children = psutil.Process(process.pid).children(recursive=True)
    (os.killpg if group else os.kill)(process.pid, number)
    out, err = process.communicate(timeout=HANGING_S)
    assert out == ""
    assert process.returncode == 128 + number, err
    assert gone(children)
    return [line for line in err.splitlines() if line.strip()]


def gone(processes: list[psutil.Process]) -> bool:
    """Wait until processes have ended; a killed one may wait for its parent."""
    return wait_until(lambda: not any(is_at_work(process) for process in processes))


def is_at_work(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize(
    ("number", "group"),
    [
        (signal.SIGINT, True),
        pytest.param(signal.SIGTERM, True, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, False, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, True, marks=pytest.mark.slow),
    ],
)
def test_generate_shows_progress_and_one_line(folder: Path, number: int, group: bool) -> None:
    process = started(folder, "generate road -o data --seeds 1:4 --jobs 2 --verbose")
    wait_until_held(process, folder)
    assert len(list((folder / "temporary").glob("cosim-*"))) == 1
    lines = ended(process, number, group)
    assert lines[-1] == KEPT
    # Beside the lines of progress, the episode that was finished.
    others = [line for line in lines[:-1] if not line.startswith("generating: ")]
    assert [line.split(",")[0] for line in others] == ["road-1: 2 samples"]
    assert [path.name for path in (folder / "data/shards").iterdir()] == ["road-1.parquet"]
    assert list((folder / "temporary").glob("cosim-*")) == []


@pytest.mark.slow
def test_sense_shows_progress_and_one_line(folder: Path) -> None:
    study = small_study(seeds={"first": 1, "last": 3})
    generate(study, folder / "made", InlineEngine(), source=ScriptedSource(folder / "road"))
    process = started(folder, "sense made -o data --sensor truth --jobs 2")
    wait_until_held(process, folder)
    lines = ended(process, signal.SIGTERM)
    assert lines[-1] == KEPT
    assert [line for line in lines[:-1] if not line.startswith("sensing: ")] == []
    assert [path.name for path in (folder / "data/shards").iterdir()] == ["road-1.parquet"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_while_workers_start_shows_the_same(folder: Path, number: int) -> None:
    process = started(folder, "generate road -o data --seeds 2:3 --jobs 2 --quiet")
    command = psutil.Process(process.pid)

    def worker_starts() -> bool:
        return any("spawn_main" in " ".join(child.cmdline()) for child in command.children())

    wait_until(worker_starts, lambda: process.poll() is None)
    assert ended(process, number) == [KEPT]
    meta = read_meta(folder / "data")
    assert meta is not None
    assert not meta.complete
    assert list((folder / "temporary").glob("cosim-*")) == []


@pytest.mark.slow
def test_a_hangup_that_is_ignored_ends_nothing(folder: Path) -> None:
    process = started(folder, "generate road -o data --seeds 1:3 --jobs 2 --quiet", "nohup")
    wait_until_held(process, folder)
    os.killpg(process.pid, signal.SIGHUP)
    (folder / "gate/open").touch()
    process.communicate()
    assert process.returncode == 0
    assert len(list((folder / "data/shards").iterdir())) == 3


@pytest.mark.slow
def test_workers_end_with_a_command_that_is_killed_and_the_next_one_cleans_up(folder: Path) -> None:
    process = started(folder, "generate road -o data --seeds 1:3 --jobs 2 --quiet")
    wait_until_held(process, folder)
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate()
    assert gone(children)
    left = set((folder / "temporary").glob("cosim-*"))
    assert len(left) == 1
    (folder / "gate/open").touch()
    again = started(folder, "generate road -o data --seeds 1:3 --jobs 2 --quiet")
    again.communicate()
    assert again.returncode == 0
    assert list((folder / "temporary").glob("cosim-*")) == []


BUSY = """
import ctypes, sys
from pathlib import Path

from isac_cosim.base.workers.engine import LocalEngine


def keep_the_lock(file):
    "As C++ code that runs for long, such as SUMO reading a large network."
    file.touch()
    ctypes.PyDLL(None).sleep(600)


if __name__ == "__main__":
    list(LocalEngine(1).run(keep_the_lock, [Path("begun")]))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere the process ends when the code returns")
def test_a_worker_in_the_middle_of_a_library_ends_with_a_killed_command(folder: Path) -> None:
    (folder / "command.py").write_text(BUSY)
    process = started(folder, "")
    wait_until((folder / "begun").exists, lambda: process.poll() is None)
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate()
    assert gone(children)


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_is_delayed_and_not_lost(number: int) -> None:
    """Also where another thread, which was started before, receives the signal."""
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    before = signal.signal(number, signal.default_int_handler)
    reached: list[str] = []

    def interrupt_in_the_block() -> None:
        with interrupts.raised_alike(), interrupts.deferred(), interrupts.deferred():
            os.kill(os.getpid(), number)
            # The other thread takes it when it comes to run, which may be after the block on a busy machine.
            wait_until(lambda: number not in signal.sigpending())
            time.sleep(0.1)
            reached.append("the end of the block")

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupt_in_the_block()
    finally:
        signal.signal(number, before)
        ended.set()
        thread.join()
    assert reached == ["the end of the block"]
    assert interrupts.received() == number
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_an_object_is_deleted_is_not_lost(number: int, capfd: pytest.CaptureFixture[str]) -> None:
    """Python drops what is raised there, and would print that it did."""

    class Held:
        def __del__(self) -> None:
            signal.raise_signal(number)
            signal.getsignal(number)  # the signal is handled before this

    def work() -> None:
        with interrupts.raised_alike():
            Held()
            time.sleep(HANGING_S)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert interrupts.received() == number
    assert capfd.readouterr().err == ""
