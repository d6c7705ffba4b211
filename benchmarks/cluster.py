"""Measures what limits generation on a large cluster: the scheduler, the parent, or the list of shards.

- cluster: a dask scheduler and WORKERS workers, single-threaded processes on this machine that communicate over TLS.
  `labeling.generation.generate` generates the dataset as with `--cluster`, but an episode only waits for PAUSE_S, and
  its shard is empty. The processor time that scheduler and parent spend on an episode limits the rate at which they
  could serve any number of workers. Their memory is reported at the beginning, in the middle and at the end, because
  the scheduler's log grows during the first thousands of episodes until it reaches its fixed length.
- index: a dataset's synthetic shards, as large as the bundled motorway's, are planned, their index is written and read
  back, in a process of its own.

Run: python -m isac_cosim.benchmarks.cluster [--workers 16] [--episodes 6000] [--shards 1000 10000 100000]
"""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import pickle
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
import psutil
from distributed import Client

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import json_text
from isac_cosim.base.workers.cluster import ClusterEngine
from isac_cosim.benchmarks.scaling import MIB, apart, peak_memory
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.labeling.dataset.dataset import (
    CLASS_NAMES,
    INDEX_FILE,
    SHARDS,
    Episode,
    Shard,
    read_meta,
    shard_name,
    write_roads,
)
from isac_cosim.labeling.generation.episode_plan import EpisodePlan, Jobs
from isac_cosim.labeling.generation.folder import finish
from isac_cosim.labeling.generation.generate import describe, generate
from isac_cosim.labeling.generation.journal import Journal
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange

SCENARIO = "motorway"
WORKERS = 16
PAUSE_S = 0.05
EPISODES = 6000
LISTED = (1_000, 10_000, 100_000)
"""Numbers of synthetic shards."""
START_S = 120.0
"""How long scheduler and workers may take to start, s."""


@dataclass(frozen=True)
class Paused(MotionSource):
    """A source without traffic, whose episodes take `pause_s` seconds."""

    pause_s: float

    def load(self, where: str) -> Scenario:
        return scenario.load(where)

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return {}

    def record(self, scenario: Scenario, seed: int) -> Recording:
        time.sleep(self.pause_s)
        return Recording(scenario.name, seed, 0.01, scenario.lanes, {})

    def expected_cpu_s(self) -> float:
        return 0.0


def run(workers: int = WORKERS, episodes: int = EPISODES, shards: Sequence[int] = LISTED) -> dict[str, Any]:
    """Run the benchmark. Returns the keys `cluster`, left out without episodes, and `index`."""
    measured = {"cluster": simulated(episodes, workers)} if episodes else {}
    return {**measured, "index": [apart(indexed, number) for number in shards]}


def simulated(episodes: int, workers: int) -> dict[str, Any]:
    """Generate a dataset of short episodes on a cluster, and measure after the first two episodes per worker.

    Returns the keys `episodes_per_s`, and for `scheduler` and `parent` each `cpu_ms` per episode, the `episodes_per_s`
    that this would allow, and `mib` of memory at the beginning, in the middle and at the end.
    """
    study = DatasetStudy(scenarios=(SCENARIO,), seeds=SeedRange(first=1, last=episodes))
    first = 2 * workers
    marks_at = (first, (first + episodes) // 2, episodes)
    with tempfile.TemporaryDirectory(prefix="cosim-") as folder, cluster(Path(folder), workers) as (address, process):
        watched = {"scheduler": psutil.Process(process.pid), "parent": psutil.Process()}
        marks: list[tuple[float, dict[str, tuple[float, int]]]] = []
        ended = 0

        class Marks(Feedback):
            def detail(self, line: str) -> None:
                nonlocal ended
                ended += 1
                if ended in marks_at:
                    marks.append((time.perf_counter(), {name: _spent(process) for name, process in watched.items()}))

        generate(study, Path(folder) / "data", ClusterEngine(address), Marks(), source=Paused(PAUSE_S))
    (begin, before), (_, half), (end, after) = marks
    counted = episodes - first
    return {
        "workers": workers,
        "pause_s": PAUSE_S,
        "episodes": episodes,
        "episodes_per_s": round(counted / (end - begin), 1),
        **{
            name: {
                "cpu_ms": round(1000 * (after[name][0] - before[name][0]) / counted, 3),
                "episodes_per_s": round(counted / (after[name][0] - before[name][0])),
                "mib": [round(spent[name][1] / MIB, 1) for spent in (before, half, after)],
            }
            for name in watched
        },
    }


@dataclass(frozen=True)
class Credentials:
    """A certificate that the processes of one cluster show each other, and its key. Nobody else can connect."""

    certificate: Path
    key: Path

    @classmethod
    def new(cls, folder: Path) -> Credentials:
        """Make credentials in a folder. Raises RunError where the program openssl is missing."""
        credentials = cls(folder / "certificate.pem", folder / "key.pem")
        files = ("-out", credentials.certificate, "-keyout", credentials.key)
        curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1")
        command = ["openssl", "req", "-x509", *curve, "-nodes", "-days", "2", "-subj", "/CN=cosim", *map(str, files)]
        try:
            subprocess.run(command, check=True, capture_output=True)
        except OSError:
            raise RunError("there is no program openssl, which makes the cluster's certificate; install it") from None
        return credentials

    @property
    def words(self) -> tuple[str, ...]:
        """The options of `dask scheduler` and `dask worker`."""
        certificate = str(self.certificate)
        return ("--tls-ca-file", certificate, "--tls-cert", certificate, "--tls-key", str(self.key))

    @property
    def configuration(self) -> dict[str, object]:
        """The part of dask's configuration that a client needs."""
        certificate = str(self.certificate)
        return {
            "distributed.comm.tls.ca-file": certificate,
            "distributed.comm.tls.client.cert": certificate,
            "distributed.comm.tls.client.key": str(self.key),
        }


NO_PAGES = {f"DASK_DISTRIBUTED__{role}__HTTP__ROUTES": "[]" for role in ("SCHEDULER", "WORKER")}
"""Environment variables with which dask's processes offer no web pages, for which nobody needs credentials."""
LOCAL = ("--host", "127.0.0.1", "--no-dashboard", "--dashboard-address", "127.0.0.1:0")
"""Options of `dask scheduler` and `dask worker` with which they listen on this machine only."""


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Run a scheduler and workers on this machine for the block; yield the scheduler's address and process."""
    file, credentials = folder / "scheduler.json", Credentials.new(folder)
    running: list[subprocess.Popen[bytes]] = []
    try:
        running.append(_start("scheduler", *credentials.words, *LOCAL, "--port", "0", "--scheduler-file", str(file)))
        deadline = time.monotonic() + START_S
        while (address := _address(file)) is None:
            if time.monotonic() > deadline:
                raise RuntimeError(f"the scheduler did not start within {START_S:.0f} s")
            time.sleep(0.1)
        local = ("--nthreads", "1", "--local-directory", str(folder))
        running.append(_start("worker", address, *credentials.words, *LOCAL, "--nworkers", str(workers), *local))
        with dask.config.set(credentials.configuration):
            with Client(address) as client:
                client.wait_for_workers(workers, START_S)
            yield address, running[0]
    finally:
        for process in running:
            children = psutil.Process(process.pid).children(recursive=True)
            # The parent first: it replaces a worker that dies.
            process.kill()
            for child in children:
                with suppress(psutil.NoSuchProcess):
                    child.kill()
            process.wait()


def _address(file: Path) -> str | None:
    """Return the address in a scheduler's file, None while the file or its content is missing."""
    try:
        return str(json.loads(file.read_text())["address"])
    except (FileNotFoundError, json.JSONDecodeError):
        return None


def indexed(episodes: int) -> dict[str, Any]:
    """Plan a dataset of synthetic shards, write its index and read it back.

    Returns the keys `episodes`, processor times `plan_s`, `write_s` and `read_s`, `bytes` (of the index on disk), and
    `peak_mib` (most memory of the process).
    """
    study = DatasetStudy(scenarios=(SCENARIO,), seeds=SeedRange(first=1, last=episodes))
    started = describe(study, {SCENARIO: scenario.load(SCENARIO)})
    plan = EpisodePlan(Jobs(((SCENARIO, SCENARIO, study.seeds.numbers),)), study.selection)
    with tempfile.TemporaryDirectory(prefix="cosim-") as name:
        folder = Path(name)
        (folder / SHARDS).mkdir()
        journal = Journal.open(folder, started)
        begin = time.process_time()
        for job in plan.missing():
            # Pickled, as from a worker, so that it shares nothing with the others.
            shard = pickle.loads(pickle.dumps(synthetic_shard(job.seed)))
            journal.add(shard)
            plan.add(job, shard.by_intention)
        write_roads(folder, SCENARIO, [])
        planned = time.process_time()
        finish(folder, started, journal, (shard_name(job.scenario, job.seed) for job in plan.kept()))
        written = time.process_time()
        read_meta(folder)
        read = time.process_time()
        size = (folder / INDEX_FILE).stat().st_size
    return {
        "episodes": episodes,
        "plan_s": round(planned - begin, 2),
        "write_s": round(written - planned, 2),
        "read_s": round(read - written, 2),
        "bytes": size,
        "peak_mib": round(peak_memory() / MIB),
    }


def synthetic_shard(seed: int) -> Shard:
    """Return the entry of a shard as large as the bundled motorway's, whose counts differ from shard to shard."""
    drawn = random.Random(seed)
    counts = {name: drawn.randint(1, 20) for name in CLASS_NAMES}
    left_out = {"ambiguous": 500, "no_uv": 300, "tv_outside_track": 200, "beyond_cap": 100}
    episode = Episode(
        scenario=SCENARIO,
        seed=seed,
        fingerprint="0" * 64,
        events={name: drawn.randint(50, 150) for name in CLASS_NAMES},
        counts={"hard_brake_in_queue": 10, "short_change": 20},
        left_out={reason: drawn.randint(number // 2, 2 * number) for reason, number in left_out.items()},
        collided=5,
        fix_error_m=tuple(0.02 + k * 1e-5 for k in range(130)),
        state_error_m=tuple(0.002 + k * 1e-6 for k in range(130)),
    )
    return Shard(
        file=shard_name(SCENARIO, seed),
        sha256=hashlib.sha256(str(seed).encode()).hexdigest(),
        bytes=drawn.randint(7_000_000, 8_000_000),
        samples=sum(counts.values()),
        by_intention=counts,
        by_origin={"natural": 5, "commanded": sum(counts.values()) - 5},
        episode=episode,
    )


def _start(*words: str) -> subprocess.Popen[bytes]:
    """Start a dask process in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *words],
        env={**os.environ, **NO_PAGES, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _spent(process: psutil.Process) -> tuple[float, int]:
    """Return the processor time, s, and resident memory, bytes, of a process."""
    times = process.cpu_times()
    return times.user + times.system, process.memory_info().rss


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m isac_cosim.benchmarks.cluster")
    parser.add_argument("--workers", type=int, default=WORKERS)
    parser.add_argument("--episodes", type=int, default=EPISODES, help="0 leaves the cluster out")
    parser.add_argument("--shards", type=int, nargs="*", default=LISTED)
    # Imported by name, so that workers find the functions that are sent to them.
    print(json_text(importlib.import_module("isac_cosim.benchmarks.cluster").run(**vars(parser.parse_args())), 2))
