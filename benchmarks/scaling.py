"""Measures how generation scales with the work and with a second worker process, and the memory of the parent process.

The work consists of short episodes of the bundled motorway. The same few traffic seeds repeat: k times the work
gives exactly k times the samples. Each dataset is generated and summarised as by `cosim generate`, with its own
workers, in a fresh process. The peak memory of that process is the parent's: scheduler and metadata, no simulation.

Start-up is not work: `start_s` ends when the first episode begins, and `end_s` begins when the last one ends.

Run: python -m isac_cosim.benchmarks.scaling
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import psutil

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import json_text
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.dataset.summary import summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.log import LOG_FILE
from isac_cosim.labeling.generation.settings import DatasetStudy

Result = TypeVar("Result")

SCENARIO = "motorway"
TRAFFIC = TrafficSettings(run_in_s=45.0, duration_s=40.0)
"""Takes about 2.3 s of one core and gives about ten samples."""
UNIT = 12
"""Number of episodes of the smallest work."""
SIZES = (1, 2, 4, 8)
"""Sizes of the work, in units."""
JOBS = 2
COMPARED = 4
"""Size at which `JOBS` workers are compared with one."""
MIB = 2**20


@dataclass(frozen=True)
class Repeated(MotionSource):
    """A source that repeats the traffic of seeds 1 to `period` over and over."""

    source: MotionSource
    period: int

    def load(self, where: str) -> Scenario:
        return self.source.load(where)

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return self.source.inputs(scenario)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        return replace(self.source.record(scenario, 1 + (seed - 1) % self.period), seed=seed)

    def expected_cpu_s(self) -> float:
        return self.source.expected_cpu_s()


@dataclass(frozen=True)
class Measurement:
    """The generation of one dataset.

    seconds: total duration. start_s: time until the first episode began. end_s: time after the last one ended.
    episode_s: mean duration of an episode in its worker. parent_peak_bytes: most resident memory of the parent.
    """

    jobs: int
    episodes: int
    samples: int
    seconds: float
    start_s: float
    end_s: float
    episode_s: float
    parent_peak_bytes: int

    @property
    def rate(self) -> float:
        """Samples per second, from the beginning of the first episode to the end of the last."""
        return self.samples / (self.seconds - self.start_s - self.end_s)

    def result(self) -> dict[str, Any]:
        """Return the measurement as plain, rounded values."""
        return {
            "jobs": self.jobs,
            "episodes": self.episodes,
            "samples": self.samples,
            "seconds": round(self.seconds, 1),
            "start_s": round(self.start_s, 2),
            "end_s": round(self.end_s, 2),
            "episode_s": round(self.episode_s, 3),
            "samples_per_s": round(self.rate, 2),
            "samples_per_s_with_start": round(self.samples / self.seconds, 2),
            "parent_peak_mib": round(self.parent_peak_bytes / MIB, 1),
        }


def run() -> dict[str, Any]:
    """Run the benchmark.

    Returns the keys `ratio` (samples per second of two workers over one), `ratio_of`, `ratio_with_start` (the same with
    start-up), `spread` and `spread_with_start` (of samples per second over the sizes: greatest over least, minus 1),
    `parent_growth_mib` (growth of the peak memory from the smallest to the largest work), `runs` and `settings`.
    """
    single = apart(measure, COMPARED * UNIT, 1)
    by_size = {size: apart(measure, size * UNIT, JOBS) for size in SIZES}
    return summarise(single, by_size)


def summarise(single: Measurement, by_size: dict[int, Measurement]) -> dict[str, Any]:
    """Return the result of the benchmark. single: with one worker. by_size: with `JOBS` workers."""
    runs = list(by_size.values())
    two = by_size[COMPARED]
    return {
        "ratio": round(two.rate / single.rate, 3),
        "ratio_of": f"samples per second of {JOBS} workers over 1 worker, {single.episodes} episodes, without start-up",
        "ratio_with_start": round(two.samples / two.seconds / (single.samples / single.seconds), 3),
        "spread": _spread([run.rate for run in runs]),
        "spread_with_start": _spread([run.samples / run.seconds for run in runs]),
        "parent_growth_mib": round((runs[-1].parent_peak_bytes - runs[0].parent_peak_bytes) / MIB, 1),
        "runs": [run.result() for run in (single, *runs)],
        "settings": {"scenario": SCENARIO, "seeds": UNIT, **TRAFFIC.model_dump()},
    }


def apart(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function in a process of its own and return its result."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        return process.submit(function, *arguments).result()


def measure(episodes: int, jobs: int) -> Measurement:
    """Generate a dataset in a temporary folder and measure that."""
    content = {"scenarios": [SCENARIO], "seeds": {"first": 1, "last": episodes}, "traffic": TRAFFIC}
    study = DatasetStudy.model_validate(content)
    source = Repeated(motion_source(study), UNIT)
    ended_at: list[float] = []

    class Times(Feedback):
        def detail(self, line: str) -> None:
            ended_at.append(time.perf_counter())

    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        dataset = generate(study, Path(folder) / "data", LocalEngine(jobs), Times(), source=source)
        entries = [json.loads(line) for line in (Path(folder) / "data" / LOG_FILE).read_text().splitlines()]
        ended = [(at, entry["seconds"] or 0.0) for at, entry in zip(ended_at, entries, strict=True)]
        summary(dataset)
        end = time.perf_counter()
    if dataset.meta.lost:
        raise RuntimeError(f"{len(dataset.meta.lost)} episodes were lost: {dataset.meta.lost[0].reason}")
    return Measurement(
        jobs=jobs,
        episodes=episodes,
        samples=len(dataset),
        seconds=end - begin,
        start_s=min(at - seconds for at, seconds in ended) - begin,
        end_s=end - ended[-1][0],
        episode_s=float(np.mean([seconds for _, seconds in ended])),
        parent_peak_bytes=peak_memory(),
    )


def peak_memory() -> int:
    """Return the most memory that this process has had resident, bytes."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage also counts the process that this one was forked from.
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024
    import resource  # Windows has none

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _spread(rates: Sequence[float]) -> float:
    """Return how much the greatest rate exceeds the least, as a share of the least."""
    return round(max(rates) / min(rates) - 1, 3)


if __name__ == "__main__":
    # Imported by name, so that workers find the functions that are sent to them.
    print(json_text(importlib.import_module("isac_cosim.benchmarks.scaling").run(), 2))
