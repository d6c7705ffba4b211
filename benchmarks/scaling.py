"""How the making of a dataset scales: with the work, with a second worker process, and what its parent holds meanwhile.

The work is short episodes of the bundled motorway, the same few traffic seeds over and over: k times the work is k
times the same, down to the samples. Each dataset is made and summed up as by `cosim generate`, with workers of its own,
out of a fresh process, whose peak memory is the parent's: scheduler and metadata, no simulation.

Start-up is told apart from work: `start_s` ends when the first episode begins, `end_s` begins when the last one ended.

Run: python -m benchmarks.scaling
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import psutil

from isacsim.feedback import Feedback
from isacsim.scenarios.scenario import Scenario
from isacsim.traffic.recording import Recording
from isacsim.traffic.simulation import TrafficSettings
from labeling.dataset.summary import summary
from labeling.generation.engine import LocalEngine
from labeling.generation.episode import SumoSource
from labeling.generation.generate import generate
from labeling.generation.log import LOG_FILE
from labeling.generation.settings import DatasetStudy, SeedRange

Result = TypeVar("Result")

SCENARIO = "motorway"
TRAFFIC = TrafficSettings(run_in_s=45.0, duration_s=40.0)
"""About 2.3 s of one core, for about ten samples."""
UNIT = 12
"""Episodes of the smallest work."""
SIZES = (1, 2, 4, 8)
"""Times the smallest work."""
JOBS = 2
COMPARED = 4
"""The size at which `JOBS` workers are compared with one."""
MIB = 2**20


@dataclass(frozen=True)
class Repeated:
    """A source whose seeds drive as seeds 1 to `period` do, over and over."""

    source: SumoSource
    period: int

    def load(self, where: str) -> Scenario:
        return self.source.load(where)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        return replace(self.source.record(scenario, 1 + (seed - 1) % self.period), seed=seed)


@dataclass(frozen=True)
class Made:
    """One dataset as it was made.

    seconds: in all; start_s: until the first episode began; end_s: after the last one ended. episode_s: mean time of an
    episode in its worker. parent_peak_bytes: most memory that the parent had resident.
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
        """Samples a second, from the first episode's begin to the last one's end."""
        return self.samples / (self.seconds - self.start_s - self.end_s)

    def told(self) -> dict[str, Any]:
        """For the bench's result."""
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
    """Measure.

    Keys `ratio` (samples a second of two workers over one), `ratio_with_start` (the same, start-up included), `spread`
    and `spread_with_start` (of samples a second over the sizes: greatest over least, less 1), `parent_growth_mib` (of
    its peak memory, from the smallest to the greatest work), `runs`.
    """
    one = apart(make, COMPARED * UNIT, 1)
    several = {size: apart(make, size * UNIT, JOBS) for size in SIZES}
    return summed_up(one, several)


def summed_up(one: Made, several: dict[int, Made]) -> dict[str, Any]:
    """The bench's result. one: made by one worker; several: by `JOBS`, by size."""
    runs = list(several.values())
    two = several[COMPARED]
    return {
        "ratio": round(two.rate / one.rate, 3),
        "ratio_of": f"samples a second of {JOBS} workers over 1 worker, {one.episodes} episodes, start-up left out",
        "ratio_with_start": round(two.samples / two.seconds / (one.samples / one.seconds), 3),
        "spread": _spread([each.rate for each in runs]),
        "spread_with_start": _spread([each.samples / each.seconds for each in runs]),
        "parent_growth_mib": round((runs[-1].parent_peak_bytes - runs[0].parent_peak_bytes) / MIB, 1),
        "runs": [each.told() for each in (one, *runs)],
        "settings": {"scenario": SCENARIO, "seeds": UNIT, **TRAFFIC.model_dump()},
    }


def apart(function: Callable[..., Result], *arguments: Any) -> Result:
    """What a function returns, called in a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        return process.submit(function, *arguments).result()


def make(episodes: int, jobs: int) -> Made:
    """Make a dataset of so many episodes, in a folder that is deleted afterwards."""
    study = DatasetStudy(scenarios=(SCENARIO,), seeds=SeedRange(first=1, last=episodes), traffic=TRAFFIC)
    source = Repeated(SumoSource(study.traffic, study.maneuvers), UNIT)
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
    return Made(
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
    return round(max(rates) / min(rates) - 1, 3)


if __name__ == "__main__":
    # By its name, so that workers find what is sent to them.
    print(json.dumps(importlib.import_module("benchmarks.scaling").run(), indent=2))
