"""What the environment variables that `isac_cosim` sets are worth to a training step.

    python -m isac_cosim.benchmarks.environment

- `OMP_WAIT_POLICY=passive`: idle OpenMP threads sleep instead of spin. A step on two threads is timed under both
  policies, alone and beside two busy processes. The ratio is that of passive over active; `slower_beside_others` is
  the time of a passive step beside them over that alone.
- `THP_MEM_ALLOC_ENABLE=1`: PyTorch asks for huge pages. The ratio is that of the processor time of a step on one
  thread with them over that without, the kernel's part included; `page_faults` are those of a step.

Beside them, `threads` says what a second thread gains: each direction of an LSTM then has its own.

A step is a whole training step of ASI-BIP, as in `benchmarks.train`. Each is timed in a process of its own, since the
libraries read the variables once. The variants take turns; times are medians over the rounds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from statistics import median
from typing import Any

WAITING = {
    "active": {"OMP_WAIT_POLICY": "active", "OMP_NUM_THREADS": "2"},
    "passive": {"OMP_WAIT_POLICY": "passive", "OMP_NUM_THREADS": "2"},
}
"""Variables of the two policies, on two threads."""
THREADS = {"one": {"OMP_NUM_THREADS": "1"}, "two": {"OMP_NUM_THREADS": "2"}}
"""Variables of one thread and of two, with the policy of isacsim."""
PAGES = {
    "small_pages": {"THP_MEM_ALLOC_ENABLE": "0", "OMP_NUM_THREADS": "1"},
    "huge_pages": {"THP_MEM_ALLOC_ENABLE": "1", "OMP_NUM_THREADS": "1"},
}
"""Variables without and with huge pages, on one thread."""
BUSY = 2
STEPS = 6
ROUNDS = 3
STEP = """
import os
import sys
import time
from resource import RUSAGE_SELF, getrusage
import torch
from isac_cosim.benchmarks.train import NETWORKS, stepping
torch.set_num_threads(int(os.environ["OMP_NUM_THREADS"]))
step = stepping(NETWORKS["pooled"])
step()
def now():
    return time.perf_counter(), time.process_time(), getrusage(RUSAGE_SELF).ru_minflt
begin, steps = now(), int(sys.argv[1])
for _ in range(steps):
    step()
print(*((end - start) / steps for start, end in zip(begin, now())))
"""


@dataclass(frozen=True)
class Step:
    """What a training step takes: time, s; processor time, s; page faults."""

    elapsed_s: float
    cpu_s: float
    page_faults: float


def measured_step(variables: Mapping[str, str], busy: int = 0, steps: int = STEPS) -> Step:
    """Return what a training step takes in an environment, the mean of a few, beside so many busy processes."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", STEP, str(steps)],
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            check=True,
        )
    finally:
        for process in others:
            process.kill()
            process.wait()
    return Step(*(float(word) for word in done.stdout.split()))


def run() -> dict[str, Any]:
    """Return times and ratios.

    Keys: `alone` and `beside_two_busy_processes` by policy, `threads`, `pages`, `slower_beside_others`.
    """
    elapsed = attrgetter("elapsed_s")
    alone, busy = (_compared(_rounds(WAITING, count), elapsed) for count in (0, BUSY))
    pages = _rounds(PAGES)
    faults = {name: round(median(steps[name].page_faults for steps in pages)) for name in PAGES}
    return {
        "cores": os.cpu_count(),
        "alone": alone,
        "beside_two_busy_processes": busy,
        "slower_beside_others": round(busy["passive_s"] / alone["passive_s"], 2),
        "threads": _compared(_rounds(THREADS), elapsed),
        "pages": {**_compared(pages, attrgetter("cpu_s")), "page_faults": faults},
    }


def _rounds(variants: Mapping[str, Mapping[str, str]], busy: int = 0) -> list[dict[str, Step]]:
    """Return a step in each of the environments, in turn, for every round."""
    return [{name: measured_step(variables, busy) for name, variables in variants.items()} for _ in range(ROUNDS)]


def _compared(rounds: Sequence[Mapping[str, Step]], time_s: Callable[[Step], float]) -> dict[str, float]:
    """Return the median time of both variants and the ratio of the second over the first; time_s: of a step, s."""
    seconds = {name: median(time_s(steps[name]) for steps in rounds) for name in rounds[0]}
    first, second = seconds.values()
    return {f"{name}_s": round(value, 3) for name, value in seconds.items()} | {"ratio": round(second / first, 2)}


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
