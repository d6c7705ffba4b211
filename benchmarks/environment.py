"""What the environment variables that isacsim sets are worth to a training step.

    python -m benchmarks.environment

- `OMP_WAIT_POLICY=passive`: idle OpenMP threads sleep instead of spin. A step on two threads is timed under both
  policies, alone and beside two busy processes. The ratio is that of passive over active; `slower_beside_others` is
  the time of a passive step beside them over that alone.
- `THP_MEM_ALLOC_ENABLE=1`: PyTorch asks for huge pages. The ratio is that of the processor time of a step on one
  thread with them over that without, the kernel's part included.

A step is a whole training step of ASI-BIP, as in `benchmarks.train`. Each is timed in a process of its own, since the
libraries read the variables once. The variants take turns; times are medians over the rounds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from statistics import median
from typing import Any

WAITING = {
    "active": {"OMP_WAIT_POLICY": "active", "OMP_NUM_THREADS": "2"},
    "passive": {"OMP_WAIT_POLICY": "passive", "OMP_NUM_THREADS": "2"},
}
"""Variables of the two policies, on two threads."""
PAGES = {
    "small_pages": {"THP_MEM_ALLOC_ENABLE": "0", "OMP_NUM_THREADS": "1"},
    "huge_pages": {"THP_MEM_ALLOC_ENABLE": "1", "OMP_NUM_THREADS": "1"},
}
"""Variables without and with huge pages, on one thread."""
BUSY = 2
STEPS = 6
ROUNDS = 3
STEP = f"""
import os
import time
import torch
from benchmarks.train import NETWORKS, stepping
torch.set_num_threads(int(os.environ["OMP_NUM_THREADS"]))
step = stepping(NETWORKS["pooled"])
step()
begin = time.perf_counter(), time.process_time()
for _ in range({STEPS}):
    step()
print((time.perf_counter() - begin[0]) / {STEPS}, (time.process_time() - begin[1]) / {STEPS})
"""


def step_s(variables: dict[str, str], busy: int = 0) -> tuple[float, float]:
    """Return the time and the processor time of a training step beside so many busy processes, s."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", STEP], env={**os.environ, **variables}, capture_output=True, text=True, check=True
        )
    finally:
        for process in others:
            process.kill()
            process.wait()
    elapsed_s, cpu_s = (float(word) for word in done.stdout.split())
    return elapsed_s, cpu_s


def run() -> dict[str, Any]:
    """Return times and ratios: `alone` and `beside_two_busy_processes` by policy, `pages`, `slower_beside_others`."""
    elapsed = {
        name: _compared([{policy: step_s(WAITING[policy], busy)[0] for policy in WAITING} for _ in range(ROUNDS)])
        for name, busy in (("alone", 0), ("beside_two_busy_processes", BUSY))
    }
    cpu = _compared([{pages: step_s(PAGES[pages])[1] for pages in PAGES} for _ in range(ROUNDS)])
    slower = elapsed["beside_two_busy_processes"]["passive_s"] / elapsed["alone"]["passive_s"]
    return {"cores": os.cpu_count(), **elapsed, "pages": cpu, "slower_beside_others": round(slower, 2)}


def _compared(rounds: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the median time of both variants and the ratio of the second over the first."""
    seconds = {name: median(times[name] for times in rounds) for name in rounds[0]}
    first, second = seconds.values()
    return {f"{name}_s": round(time_s, 3) for name, time_s in seconds.items()} | {"ratio": round(second / first, 2)}


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
