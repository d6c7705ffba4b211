"""A running scheduler in place of own workers: the same bytes, and one line where it is not fit."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import dask
import psutil
import pytest

import cosim
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.workers import cluster
from isac_cosim.base.workers.cluster import ClusterEngine
from isac_cosim.benchmarks.cluster import LOCAL, NO_PAGES, Credentials
from isac_cosim.command_line.options import engine_of
from isac_cosim.labeling.generation.generate import generate
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.sockets import answer
from tests.support.waiting import HANGING_S, wait_until

ROOT = Path(cosim.__file__).parent


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


def start(running: list[subprocess.Popen[bytes]], role: str, *words: str) -> None:
    path = os.pathsep.join(map(str, (ROOT, Path(__file__).parent)))
    running.append(
        subprocess.Popen(
            [sys.executable, "-m", "dask", role, *LOCAL, *words],
            env={**os.environ, **NO_PAGES, "PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )


def start_scheduler(running: list[subprocess.Popen[bytes]], folder: Path, *words: str) -> str:
    """Start a scheduler on a free port of this machine; returns its address."""
    file = folder / "scheduler.json"
    start(running, "scheduler", "--port", "0", "--scheduler-file", str(file), *words)
    scheduler = running[-1]

    def address() -> str | None:
        # The file is there before its content is.
        with contextlib.suppress(FileNotFoundError, json.JSONDecodeError):
            return str(json.loads(file.read_text())["address"])
        return None

    return str(wait_until(address, lambda: scheduler.poll() is None))


@pytest.fixture
def credentials(tmp_path: Path) -> Iterator[Credentials]:
    """A certificate for a cluster, which this process has in its configuration of dask, as a user would."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificates")
    made = Credentials.new(tmp_path)
    with dask.config.set(made.configuration):
        yield made


def start_worker(running: list[subprocess.Popen[bytes]], address: str, *words: str) -> None:
    start(running, "worker", address, "--nthreads", "1", *words)


def test_no_scheduler_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ANSWER_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nowhere", "carrier://pigeon"):
        with (
            pytest.raises(InputError, match="no dask scheduler answers"),
            closing(ClusterEngine(address).run(str, [1])) as run,
        ):
            next(run)


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, credentials: Credentials
) -> None:
    (tmp_path / "road").mkdir()
    (tmp_path / "died").mkdir()
    source, study = ScriptedSource(tmp_path / "road"), small_study(seeds={"first": 1, "last": 4})
    alone = generate(study, tmp_path / "alone", InlineEngine(), source=source)
    frail = ScriptedSource(source.folder, broken=(5,), frail=tmp_path / "died")
    with processes() as running:
        address = start_scheduler(running, tmp_path, *credentials.words)
        monkeypatch.setattr(cluster, "ANSWER_S", HANGING_S)
        monkeypatch.setattr(cluster, "FIRST_WORKER_S", 0.5)
        with pytest.raises(InputError, match="has no workers"):
            generate(study, tmp_path / "none", ClusterEngine(address), source=source)
        monkeypatch.setattr(cluster, "FIRST_WORKER_S", HANGING_S)
        for _ in range(2):
            start_worker(running, address, *credentials.words)
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
def test_a_worker_of_several_threads_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, credentials: Credentials
) -> None:
    for name in ("ANSWER_S", "FIRST_WORKER_S"):
        monkeypatch.setattr(cluster, name, HANGING_S)
    with processes() as running:
        address = start_scheduler(running, tmp_path, *credentials.words)
        start(running, "worker", address, "--nthreads", "2", *credentials.words)
        with pytest.raises(InputError, match="has 2 threads"), closing(ClusterEngine(address).run(str, [1])) as run:
            next(run)


def dying(folder: Path) -> str:
    """End the process, but on the machine of the command, which tries it last."""
    tries = len(list(folder.iterdir()))
    (folder / str(tries)).touch()
    if tries < 3:
        os._exit(1)
    return "done"


@pytest.mark.slow
def test_a_task_whose_workers_die_is_tried_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, credentials: Credentials
) -> None:
    """Why they died shows here alone."""
    for name in ("ANSWER_S", "FIRST_WORKER_S"):
        monkeypatch.setattr(cluster, name, HANGING_S)
    (tmp_path / "tries").mkdir()
    with processes() as running:
        address = start_scheduler(running, tmp_path, *credentials.words)
        start_worker(running, address, *credentials.words)
        (outcome,) = ClusterEngine(address).run(dying, [tmp_path / "tries"])
    assert outcome.result == "done"


@pytest.mark.slow
def test_a_scheduler_with_certificates_answers_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, credentials: Credentials
) -> None:
    monkeypatch.setattr(cluster, "ANSWER_S", 3.0)
    with processes() as running:
        address = start_scheduler(running, tmp_path, *credentials.words)
        for other in (address, address.replace("tls://", "tcp://")):
            with (
                dask.config.set({f"distributed.comm.tls.{key}": None for key in ("ca-file", "client")}),
                pytest.raises(InputError, match="no dask scheduler answers"),
            ):
                ClusterEngine(other).check()
        host, port = address.removeprefix("tls://").split(":")
        assert answer((host, int(port))) == b""


@pytest.mark.slow
def test_an_address_without_certificates_is_warned_about_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "road").mkdir()
    for name in ("ANSWER_S", "FIRST_WORKER_S"):
        monkeypatch.setattr(cluster, name, HANGING_S)
    with processes() as running:
        address = start_scheduler(running, tmp_path)
        start_worker(running, address)
        engine_of(None, address, tmp_path / "data")
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"warning: --cluster {address}: without TLS, everyone who can connect")


def test_only_encrypted_addresses_need_no_warning() -> None:
    assert [ClusterEngine(f"{protocol}://host:1").encrypted for protocol in ("tls", "wss", "tcp", "ws")] == [
        True, True, False, False,
    ]  # fmt: skip
    assert not ClusterEngine("host:1").encrypted
