"""Killed at random moments, a dataset is finished by the same command with the bytes of an undisturbed run."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import signal
import threading
import time
from pathlib import Path

import psutil
import pytest
from scripted import InlineEngine, ScriptedSource, small_study
from test_cluster import processes, start, start_scheduler

from isacsim.errors import RunError
from labeling.dataset import Dataset
from labeling.engine import ClusterEngine, LocalEngine
from labeling.generate import generate

pytestmark = pytest.mark.slow
STUDY = small_study(seeds={"first": 1, "last": 6})


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("road")
    return generate(STUDY, folder / "data", InlineEngine(), source=ScriptedSource(folder))


def slow_source(undisturbed: Dataset) -> ScriptedSource:
    return ScriptedSource(undisturbed.path.parent, pause_s=0.5)


def _generate(folder: Path, source: ScriptedSource) -> None:
    os.setsid()
    generate(STUDY, folder, LocalEngine(2), source=source)


def finished_alone(undisturbed: Dataset, folder: Path) -> Dataset:
    """What an undisturbed command makes of what a killed one left."""
    made = generate(STUDY, folder, InlineEngine(), source=ScriptedSource(undisturbed.path.parent))
    made.verify()
    return made


@pytest.mark.parametrize("turn", range(10))
def test_the_whole_command(undisturbed: Dataset, tmp_path: Path, turn: int) -> None:
    """At any moment from its start until about the last shard."""
    process = multiprocessing.get_context("spawn").Process(
        target=_generate, args=(tmp_path / "data", slow_source(undisturbed))
    )
    process.start()
    time.sleep(random.Random(turn).uniform(1.5, 9.0))
    assert process.pid is not None
    if process.is_alive():
        # Before it has a group of its own, it has no workers either.
        if os.getpgid(process.pid) == process.pid:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.join(30)
    assert finished_alone(undisturbed, tmp_path / "data").digest == undisturbed.digest


@pytest.mark.parametrize("turn", range(10))
def test_workers(undisturbed: Dataset, tmp_path: Path, turn: int) -> None:
    """Two of them, one after the other, at random moments: nothing is lost, and what was tried again is logged."""
    draw, done, killed = random.Random(turn), threading.Event(), []

    def kill() -> None:
        for _ in range(2):
            done.wait(draw.uniform(1.5, 4.0))
            workers = [each for each in psutil.Process().children() if "spawn_main" in " ".join(each.cmdline())]
            if workers and not done.is_set():
                killed.append(draw.choice(workers))
                killed[-1].kill()

    killer = threading.Thread(target=kill)
    killer.start()
    made = generate(STUDY, tmp_path / "data", LocalEngine(2), source=slow_source(undisturbed))
    done.set()
    killer.join()
    assert killed
    assert made.meta.lost == ()
    assert made.digest == undisturbed.digest
    retries = sum(json.loads(line)["retries"] for line in (made.path / "log.jsonl").read_text().splitlines())
    assert retries <= len(killed)


@pytest.mark.parametrize("turn", range(5))
def test_the_scheduler(undisturbed: Dataset, tmp_path: Path, turn: int) -> None:
    """One that runs by itself goes away at a random moment: one line, and another command finishes the dataset."""
    with processes() as running:
        address = start_scheduler(running, tmp_path)
        for _ in range(2):
            start(running, "worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard")
        draw = random.Random(turn)
        after, pause_s = draw.randrange(1, 5), draw.uniform(0.0, 0.5)

        def progress(done: int, total: int) -> None:
            if done == after:
                time.sleep(pause_s)
                os.killpg(running[0].pid, signal.SIGKILL)

        with pytest.raises(RunError, match="scheduler went away"):
            generate(STUDY, tmp_path / "data", ClusterEngine(address), progress, slow_source(undisturbed))
    assert finished_alone(undisturbed, tmp_path / "data").digest == undisturbed.digest
