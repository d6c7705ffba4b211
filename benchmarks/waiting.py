"""What waiting passively costs and gains: training steps with idle OpenMP threads that spin, and with ones that sleep.

    python -m benchmarks.waiting

A step trains ASI-BIP's two LSTMs at full rate on 32 windows, on two threads. It is timed alone and beside two busy
processes, in processes of their own, since OpenMP reads OMP_WAIT_POLICY once. The policies take turns; times are
medians over the rounds. The ratio is passive over active.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from statistics import median
from typing import Any

POLICIES = ("active", "passive")
BUSY = 2
STEPS = 6
ROUNDS = 3
STEP = f"""
import time
import torch
torch.set_num_threads(2)
torch.manual_seed(0)
lstms = [torch.nn.LSTM(6, 64, bidirectional=True) for _ in range(2)]
windows = [torch.randn(steps, 32, 6) for steps in (880, 220)]
def step():
    sum(lstm(window)[0].square().mean() for lstm, window in zip(lstms, windows)).backward()
step()
begin = time.perf_counter()
for _ in range({STEPS}):
    step()
print((time.perf_counter() - begin) / {STEPS})
"""


def step_s(policy: str, busy: int) -> float:
    """Return the time of a training step beside so many busy processes, s."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", STEP],
            env={**os.environ, "OMP_WAIT_POLICY": policy, "OMP_NUM_THREADS": "2"},
            capture_output=True,
            text=True,
            check=True,
        )
        return float(done.stdout)
    finally:
        for process in others:
            process.kill()
            process.wait()


def run() -> dict[str, Any]:
    """Return the time of a step by policy, alone and beside busy processes, and the ratios of passive over active."""
    result: dict[str, Any] = {"cores": os.cpu_count()}
    for name, busy in (("alone", 0), ("beside_two_busy_processes", BUSY)):
        rounds = [{policy: step_s(policy, busy) for policy in POLICIES} for _ in range(ROUNDS)]
        seconds = {policy: median(times[policy] for times in rounds) for policy in POLICIES}
        result[name] = {f"{policy}_s": round(seconds[policy], 3) for policy in POLICIES}
        result[name]["ratio"] = round(seconds["passive"] / seconds["active"], 2)
    return result


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
