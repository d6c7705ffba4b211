"""A running scheduler in place of own workers: the same bytes, and one line where it is not fit."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psutil
import pytest

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.workers import engine
from isac_cosim.base.workers.engine import ClusterEngine
from isac_cosim.labeling.generation.generate import generate
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.waiting import HANGING_S, wait_until

ROOT = Path(engine.__file__).parents[2]


@contextmanager
def processes() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Collects processes, and ends them, and what they started, at the end."""
    running: list[subprocess.Popen[bytes]] = []
    try:
        yield running
    finally:
        for process in running:
            if process.poll() is None:
                kill(process)
            process.wait()


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and what it started."""
    children = psutil.Process(process.pid).children(recursive=True)
    # The parent first: it replaces a worker that dies.
    process.kill()
    for child in children:
        with contextlib.suppress(psutil.NoSuchProcess):
            child.kill()


def start(running: list[subprocess.Popen[bytes]], *words: str) -> None:
    path = os.pathsep.join(map(str, (ROOT, Path(__file__).parent)))
    running.append(
        subprocess.Popen(
            [sys.executable, "-m", "dask", *words],
            env={**os.environ, "PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )


def start_scheduler(running: list[subprocess.Popen[bytes]], folder: Path) -> str:
    """Start a scheduler on a free port of this machine; returns its address."""
    file = folder / "scheduler.json"
    start(running, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    scheduler = running[-1]

    def address() -> str | None:
        # The file is there before its content is.
        with contextlib.suppress(FileNotFoundError, json.JSONDecodeError):
            return str(json.loads(file.read_text())["address"])
        return None

    return str(wait_until(address, lambda: scheduler.poll() is None))


def test_no_scheduler_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "ANSWER_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nowhere", "carrier://pigeon"):
        with (
            pytest.raises(InputError, match="no dask scheduler answers"),
            closing(ClusterEngine(address).run(str, [1])) as run,
        ):
            next(run)


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "road").mkdir()
    (tmp_path / "died").mkdir()
    source, study = ScriptedSource(tmp_path / "road"), small_study(seeds={"first": 1, "last": 4})
    alone = generate(study, tmp_path / "alone", InlineEngine(), source=source)
    frail = ScriptedSource(source.folder, broken=(5,), frail=tmp_path / "died")
    with processes() as running:
        address = start_scheduler(running, tmp_path)
        monkeypatch.setattr(engine, "ANSWER_S", HANGING_S)
        monkeypatch.setattr(engine, "FIRST_WORKER_S", 0.5)
        with pytest.raises(InputError, match="has no workers"):
            generate(study, tmp_path / "none", ClusterEngine(address), source=source)
        monkeypatch.setattr(engine, "FIRST_WORKER_S", HANGING_S)
        for _ in range(2):
            start(running, "worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard")
        distributed = generate(study, tmp_path / "made", ClusterEngine(address), source=frail)
        assert {path.name for path in (tmp_path / "died").iterdir()} == {"1", "2", "3", "4"}
        assert distributed.digest == alone.digest
        for shard in distributed.meta.shards:
            assert distributed.shard_path(shard).read_bytes() == alone.shard_path(shard).read_bytes()

        def progress(done: float, total: float) -> None:
            # Two of the four episodes are handed over only after this.
            if done == 1:
                kill(running[0])

        with pytest.raises(RunError, match="scheduler went away"):
            generate(study, tmp_path / "cut", ClusterEngine(address), RecordedFeedback(on_move=progress), source)
    assert generate(study, tmp_path / "cut", InlineEngine(), source=source).digest == alone.digest


@pytest.mark.slow
def test_a_worker_of_several_threads_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ANSWER_S", "FIRST_WORKER_S"):
        monkeypatch.setattr(engine, name, HANGING_S)
    with processes() as running:
        address = start_scheduler(running, tmp_path)
        start(running, "worker", address, "--host", "127.0.0.1", "--nthreads", "2", "--no-dashboard")
        with pytest.raises(InputError, match="has 2 threads"), closing(ClusterEngine(address).run(str, [1])) as run:
            next(run)
