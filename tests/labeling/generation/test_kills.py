"""Killed at random moments, a dataset is finished by the same command with the bytes of an undisturbed run."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import psutil
import pytest

from isac_cosim.base.errors import RunError
from isac_cosim.base.workers.cluster import ClusterEngine
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.benchmarks.cluster import Credentials
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.labeling.generation.test_cluster import credentials, processes, start_scheduler, start_worker  # noqa: F401 - one is a fixture
from tests.labeling.generation.test_cluster import kill as kill_tree
from tests.labeling.generation.test_generate import workers
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.waiting import wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX"),
]
SEEDS = {"first": 1, "last": 6}
STUDY = small_study(seeds=SEEDS)
MASTS = "".join(
    f'<poi id="s{k}" x="{60 + 150 * (k // 2)}" y="{80 if k % 2 else -80}" type="isac_site">'
    f'<param key="height" value="15"/><param key="azimuth" value="{0 if k % 2 else 180}"/></poi>'
    for k in range(14)
)
stood: list[str] = []
"""How many shards stood when a whole command was killed, and of how many."""


@pytest.fixture(scope="module", autouse=True)
def report_kills() -> Iterator[None]:
    """Print, with `pytest -s`, when the whole commands were killed."""
    yield
    print(f"shards that stood when the command was killed: {', '.join(stood)}")


@dataclass(frozen=True)
class Work:
    """A study, where its motion comes from (SUMO when absent), and what an undisturbed command made of it, in s."""

    study: DatasetStudy
    source: ScriptedSource | None
    undisturbed: Dataset
    took_s: float


def command(folder: Path, study: DatasetStudy, source: ScriptedSource | None) -> None:
    """What runs in a process of its own, at the head of a group with its workers."""
    os.setsid()
    generate(study, folder, LocalEngine(2), source=source)


def started(folder: Path, study: DatasetStudy, source: ScriptedSource | None) -> multiprocessing.process.BaseProcess:
    process = multiprocessing.get_context("spawn").Process(target=command, args=(folder, study, source))
    process.start()
    return process


def undisturbed_work(folder: Path, study: DatasetStudy, source: ScriptedSource | None) -> Work:
    began = time.monotonic()
    process = started(folder / "data", study, source)
    process.join()
    return Work(study, source, Dataset.open(folder / "data"), time.monotonic() - began)


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Work:
    folder = tmp_path_factory.mktemp("scripted")
    return undisturbed_work(folder, STUDY, ScriptedSource(folder, pause_s=0.5))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Work:
    folder = tmp_path_factory.mktemp("simulated")
    cars = "".join(vehicle(f"v{k}", depart=2.0 * k, lane=k % 2, speed=20.0) for k in range(12))
    study = small_study(
        scenarios=[str(straight_road(folder / "r", cars, MASTS))],
        seeds=SEEDS,
        traffic={"run_in_s": 20.0, "duration_s": 20.0},
        maneuvers={"rest_s": 1.0},
    )
    return undisturbed_work(folder, study, None)


@pytest.mark.parametrize("turn", range(10))
def test_the_whole_command(tmp_path: Path, turn: int, request: pytest.FixtureRequest) -> None:
    """At any moment from its start until about its end; every other time in SUMO's traffic."""
    work: Work = request.getfixturevalue("simulated" if turn % 2 else "scripted")
    process = started(tmp_path / "data", work.study, work.source)
    time.sleep(random.Random(turn).uniform(0.1, 1.0) * work.took_s)
    assert process.pid is not None
    if process.is_alive():
        # Not yet at the head of its group, it has no workers, either.
        if os.getpgid(process.pid) == process.pid:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.join()
    stood.append(f"{len(list(tmp_path.glob('data/shards/[!.]*')))} of {len(work.undisturbed.meta.shards)}")
    dataset = generate(work.study, tmp_path / "data", InlineEngine(), source=work.source)
    dataset.verify()
    assert dataset.digest == work.undisturbed.digest


@pytest.mark.parametrize("turn", range(10))
def test_workers(scripted: Work, tmp_path: Path, turn: int) -> None:
    """Two of them, one after the other, at random moments: nothing is lost, and what was tried again is logged."""
    draw, killed = random.Random(turn), list[psutil.Process]()
    assert scripted.source is not None
    # The last episode ends after both kills, so that they meet a command at work.
    source = replace(scripted.source, held=(SEEDS["last"],), gate=tmp_path / "gate")
    source.gate.mkdir()

    def kill() -> None:
        try:
            for _ in range(2):
                time.sleep(draw.uniform(0.1, 0.5) * scripted.took_s)
                killed.append(draw.choice(wait_until(workers)))
                with contextlib.suppress(psutil.NoSuchProcess):
                    killed[-1].kill()
        finally:
            source.open()

    killer = threading.Thread(target=kill)
    killer.start()
    dataset = generate(STUDY, tmp_path / "data", LocalEngine(2), source=source)
    killer.join()
    assert len(killed) == 2
    assert dataset.meta.lost == ()
    assert dataset.digest == scripted.undisturbed.digest
    retries = sum(json.loads(line)["retries"] for line in (dataset.path / "log.jsonl").read_text().splitlines())
    assert retries <= len(killed)


@pytest.mark.parametrize("turn", range(5))
def test_the_scheduler(scripted: Work, tmp_path: Path, turn: int, credentials: Credentials) -> None:  # noqa: F811
    """One that runs by itself goes away at a random moment: one line, and another command finishes the dataset."""
    with processes() as running:
        address = start_scheduler(running, tmp_path, *credentials.words)
        for _ in range(2):
            start_worker(running, address, *credentials.words)
        draw = random.Random(turn)
        after, pause_s = draw.randrange(1, 5), draw.uniform(0.0, 0.5)

        def progress(done: float, total: float) -> None:
            if done == after:
                time.sleep(pause_s)
                kill_tree(running[0])

        with pytest.raises(RunError, match="scheduler went away"):
            generate(
                STUDY, tmp_path / "data", ClusterEngine(address), RecordedFeedback(on_move=progress), scripted.source
            )
    dataset = generate(STUDY, tmp_path / "data", InlineEngine(), source=scripted.source)
    dataset.verify()
    assert dataset.digest == scripted.undisturbed.digest
