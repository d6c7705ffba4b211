"""Speed of training ASI-BIP: pooled tokens against the paper read literally.

- pooled: the network of `models.predictors.asi_bip` with its defaults.
- literal: every LSTM output a token, and PyTorch's default dropout, that of attention weights included, as a module
  written straight from the paper has it.
- patched: pooled, and a step of the LSTMs takes 25 ms of samples side by side (10 of the TV, 5 of the UV), an extension
  that is not in the paper.
- bfloat16: pooled, the LSTMs in bfloat16.

Steps are full ones: windows cut, forward, focal loss, backward, Adam, in batches of 32 windows of 2.2 s. Epochs of
4,800 windows are extrapolated from a few steps; all take turns, so that a busy machine slows both. As many threads as
training has by default.

Run: python -m benchmarks.train
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import torch

from models.data.windows import Ends, Records, WindowSettings, cut
from models.predictors.asi_bip import AsiBip, AsiBipSettings
from models.predictors.losses import focal_loss
from models.run import OptimiserSettings

BATCH, EPOCH = 32, 4800
THREADS = OptimiserSettings().threads
TV_RATE_HZ, UV_RATE_HZ = 400.0, 100.0
CLASSES = 6
ROUNDS = 2
STEPS = {"pooled": 4, "literal": 1, "patched": 8, "bfloat16": 4}
"""Timed in a round."""
PYTORCH_DROPOUT = 0.1
NETWORKS = {
    "pooled": AsiBipSettings(),
    "literal": AsiBipSettings(tokens="literal", dropout=PYTORCH_DROPOUT, attention_dropout=PYTORCH_DROPOUT),
    "patched": AsiBipSettings(tv_patch=10, uv_patch=5),
    "bfloat16": AsiBipSettings(lstm_bfloat16=True),
}


def run() -> dict[str, Any]:
    """Measure; keys `ratio` (literal over pooled), `epoch_s` of each, and what they rest on."""
    threads = torch.get_num_threads()
    torch.set_num_threads(THREADS)
    try:
        return _measured()
    finally:
        torch.set_num_threads(threads)


def _measured() -> dict[str, Any]:
    steps = {name: stepping(network) for name, network in NETWORKS.items()}
    for name in steps.keys() - {"literal"}:
        steps[name]()
    rounds = [{name: _seconds(step, STEPS[name]) for name, step in steps.items()} for _ in range(ROUNDS)]
    step_s = {name: float(np.median([each[name] for each in rounds])) for name in steps}
    return {
        "ratio": round(float(np.median([each["literal"] / each["pooled"] for each in rounds])), 2),
        "ratio_of": "seconds of a literal training step with PyTorch's default dropout over those of a pooled one",
        "epoch_s": {name: round(seconds * EPOCH / BATCH, 1) for name, seconds in step_s.items()},
        "step_s": {name: round(seconds, 4) for name, seconds in step_s.items()},
        "settings": {
            "batch": BATCH,
            "windows_an_epoch": EPOCH,
            "window_s": WindowSettings().window_s,
            "threads": THREADS,
        },
        "steps_timed": {name: ROUNDS * count for name, count in STEPS.items()},
    }


def stepping(settings: AsiBipSettings) -> Callable[[], None]:
    """One training step of such a network on windows of made-up records."""
    torch.manual_seed(0)
    windows, records = WindowSettings(), made_up_records(BATCH)
    lengths = round(windows.window_s * TV_RATE_HZ), round(windows.window_s * UV_RATE_HZ)
    network = AsiBip(settings, CLASSES, *lengths).train()
    adam = torch.optim.AdamW(network.parameters(), 1e-4, weight_decay=0.0)
    ends = Ends(np.arange(BATCH), np.full(BATCH, 450))
    label = torch.tensor(records.label)

    def step() -> None:
        given = cut(records, ends, windows)
        loss = focal_loss(network(torch.from_numpy(given.tv), torch.from_numpy(given.uv)), label)
        adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()

    return step


def made_up_records(count: int) -> Records:
    """Records of 5 s of noise: how long a step takes does not depend on the values."""
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"label": np.arange(count) % CLASSES})
    tv, uv = (rng.normal(size=(count, 6, round(5 * rate))).astype(np.float32) for rate in (TV_RATE_HZ, UV_RATE_HZ))
    return Records(tv, uv, TV_RATE_HZ, UV_RATE_HZ, table)


def _seconds(step: Callable[[], None], count: int) -> float:
    """Of one step, over `count` of them."""
    begin = time.perf_counter()
    for _ in range(count):
        step()
    return (time.perf_counter() - begin) / count


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
