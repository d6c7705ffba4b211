"""Ctrl-C in a terminal, which reaches the command and its worker processes alike: one line, and nothing is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest

import cosim
from isac_cosim.base.workers import interrupts
from isac_cosim.labeling.dataset.dataset import read_meta
from isac_cosim.labeling.generation.generate import generate
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX")

ROOT = Path(cosim.__file__).parent
COMMAND = """
import signal, sys, time
from functools import partial
from pathlib import Path

from isac_cosim.labeling.generation import generate, resense
from tests.support.scripted import ScriptedSource

road, gate = Path("road"), Path("gate")
source = ScriptedSource(road.resolve(), held=(2, 3), gate=gate.resolve())
generate.generate = partial(generate.generate, source=source)
write_shard = resense.write_shard


def write_or_wait(folder, samples, episode, *lengths):
    "In the workers of `cosim sense`, which load this file, too."
    if episode.seed in source.held:
        source._pass_gate(episode.seed)
    return write_shard(folder, samples, episode, *lengths)


resense.write_shard = write_or_wait

if __name__ == "__main__":
    import cosim

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    sys.exit(cosim.main())
"""
KEPT = "cosim: interrupted; what was finished is kept, and the same command continues from there"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the command, whose episodes of seeds 2 and 3 never end."""
    (tmp_path / "command.py").write_text(COMMAND)
    for name in ("road", "gate"):
        (tmp_path / name).mkdir()
    return tmp_path


def started(folder: Path, words: str) -> subprocess.Popen[str]:
    """Start the command as a terminal does: at the head of a process group of its own."""
    path = os.pathsep.join(map(str, (ROOT, *filter(None, [os.environ.get("PYTHONPATH")]))))
    return subprocess.Popen(
        [sys.executable, "command.py", *words.split()],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until_held(process: subprocess.Popen[str], folder: Path) -> None:
    """Wait until both workers are at an episode that never ends."""
    held = {"2", "3"}
    wait_until(lambda: {path.name for path in (folder / "gate").iterdir()} == held, lambda: process.poll() is None)


def interrupted(process: subprocess.Popen[str]) -> list[str]:
    """Send Ctrl-C to the whole group; return the lines of standard error."""
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate()
    assert out == ""
    assert process.returncode == 130, err
    return [line for line in err.splitlines() if line.strip()]


def test_generate_shows_progress_and_one_line(folder: Path) -> None:
    process = started(folder, "generate road -o data --seeds 1:4 --jobs 2 --verbose")
    wait_until_held(process, folder)
    lines = interrupted(process)
    assert lines[-1] == KEPT
    # Beside the progress bar, in which there is no other line, and the episode that was finished.
    others = [line for line in lines[:-1] if not line.startswith("generating ")]
    assert [line.split(",")[0] for line in others] == ["road-1: 2 samples"]
    assert [path.name for path in (folder / "data/shards").iterdir()] == ["road-1.parquet"]


def test_sense_shows_progress_and_one_line(folder: Path) -> None:
    study = small_study(seeds={"first": 1, "last": 3})
    generate(study, folder / "made", InlineEngine(), source=ScriptedSource(folder / "road"))
    process = started(folder, "sense made -o data --sensor truth --jobs 2")
    wait_until_held(process, folder)
    lines = interrupted(process)
    assert lines[-1] == KEPT
    assert [line for line in lines[:-1] if not line.startswith("sensing ")] == []
    assert [path.name for path in (folder / "data/shards").iterdir()] == ["road-1.parquet"]


def test_an_interrupt_while_workers_start_shows_the_same(folder: Path) -> None:
    process = started(folder, "generate road -o data --seeds 2:3 --jobs 2 --quiet")
    command = psutil.Process(process.pid)

    def worker_starts() -> bool:
        return any("spawn_main" in " ".join(child.cmdline()) for child in command.children())

    wait_until(worker_starts, lambda: process.poll() is None)
    assert interrupted(process) == [KEPT]
    meta = read_meta(folder / "data")
    assert meta is not None
    assert not meta.complete


def test_workers_ignore_the_interrupt_where_it_cannot_be_hidden_from_them() -> None:
    """As on Windows, where signals have no masks: the preload of a worker's process alone."""
    script = (
        "import os, signal; from isac_cosim.base.workers import interrupts; "
        "signal.signal(signal.SIGINT, signal.default_int_handler); "
        "interrupts.dask_setup(None); os.kill(os.getpid(), signal.SIGINT); print('alive')"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "alive\n"


def test_an_interrupt_is_delayed_and_not_lost() -> None:
    """Also where another thread, which was started before, receives the signal."""
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    reached: list[str] = []

    def interrupt_in_the_block() -> None:
        with interrupts.deferred():
            os.kill(os.getpid(), signal.SIGINT)
            reached.append("the end of the block")

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupt_in_the_block()
    finally:
        signal.signal(signal.SIGINT, before)
        ended.set()
        thread.join()
    assert reached == ["the end of the block"]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
