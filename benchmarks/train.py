"""Speed of training ASI-BIP: pooled tokens against a literal reading of the paper.

- pooled: the network of `models.predictors.asi_bip` with its defaults, but all in float32, as are the next three.
- literal: every LSTM output is a token, as in the paper, without dropout of attention weights; PyTorch then computes
  the attention in one fused step.
- literal_pytorch: the same with PyTorch's default dropout, also of attention weights, as in a module written straight
  from the paper. The dropout rules the fused step out.
- patched: pooled, and one step of the LSTMs takes 25 ms of samples side by side (10 of the TV, 5 of the UV), an
  extension that is not in the paper.
- bfloat16: pooled, with the LSTMs in bfloat16, as is the default.

A step is a whole one: cut the windows, forward, focal loss, backward, optimiser, in batches of 32 windows of 2.2 s.
The ratio is that against the faster literal network. Epochs of 4,800 windows are extrapolated from a few steps. The
networks take turns, so that other load on the machine slows all of them. The number of threads is the default of
training. `environment` is the result of `benchmarks.environment`: what sleeping threads and huge pages are worth.

Run: python -m isac_cosim.benchmarks.train
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import torch

from isac_cosim.base.files import json_text
from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.benchmarks import environment
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.models.data.fit_settings import OptimiserSettings
from isac_cosim.models.data.windows import Ends, Records, WindowSettings, cut
from isac_cosim.models.networks.losses import focal_loss
from isac_cosim.models.predictors.asi_bip import AsiBip, AsiBipSettings

BATCH, EPOCH = 32, 4800
THREADS = OptimiserSettings().threads
TV_RATE_HZ, UV_RATE_HZ = 400.0, 100.0
CLASSES = 6
ROUNDS = 2
STEPS = {"pooled": 4, "literal": 1, "literal_pytorch": 1, "patched": 8, "bfloat16": 4}
"""Steps of each network that a round times."""
PYTORCH_DROPOUT = 0.1
FLOAT32 = AsiBipSettings(lstm_bfloat16=False)
NETWORKS = {
    "pooled": FLOAT32,
    "literal": FLOAT32.model_copy(update={"tokens": "literal"}),
    "literal_pytorch": FLOAT32.model_copy(
        update={"tokens": "literal", "dropout": PYTORCH_DROPOUT, "attention_dropout": PYTORCH_DROPOUT}
    ),
    "patched": FLOAT32.model_copy(update={"tv_patch": 10, "uv_patch": 5}),
    "bfloat16": AsiBipSettings(),
}
RATIOS = (
    Ratio(("ratio",), "training step with every LSTM output a token over pooled tokens", "the LSTMs' 880 steps"),
    Ratio(("ratio_pytorch",), "the same with dropout of attention weights", "the LSTMs' 880 steps"),
    Ratio(("ratio_bfloat16",), "training step with the LSTMs in bfloat16 over float32", "the LSTMs' 880 steps"),
    Ratio(("environment", "alone", "ratio"), "step alone: sleeping over spinning threads", "waking threads"),
    Ratio(
        ("environment", "beside_two_busy_processes", "ratio"),
        "step beside two busy processes: sleeping over spinning threads",
        "the share of the cores",
    ),
    Ratio(
        ("environment", "slower_beside_others"), "step beside two busy processes over alone", "the share of the cores"
    ),
    Ratio(("environment", "threads", "ratio"), "step on two threads over one", "the threads' waiting for each other"),
    Ratio(("environment", "pages", "ratio"), "processor time of a step: huge over small pages", "the LSTMs' 880 steps"),
)


def run() -> dict[str, Any]:
    """Return the ratios, `epoch_s` of each network, `environment`, and how they were measured."""
    with torch_threads(THREADS):
        return {**_measured(), "environment": environment.run()}


def _measured() -> dict[str, Any]:
    steps = {name: stepping(network) for name, network in NETWORKS.items()}
    for name in steps.keys() - {"literal", "literal_pytorch"}:
        steps[name]()
    rounds = [{name: _seconds(step, STEPS[name]) for name, step in steps.items()} for _ in range(ROUNDS)]
    step_s = {name: float(np.median([seconds[name] for seconds in rounds])) for name in steps}
    return {
        "ratio": _ratio(rounds, "literal"),
        "ratio_of": "seconds of a literal training step, attention fused, over those of a pooled one",
        "ratio_pytorch": _ratio(rounds, "literal_pytorch"),
        "ratio_bfloat16": _ratio(rounds, "bfloat16"),
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


def _ratio(rounds: list[dict[str, float]], network: str) -> float:
    """Return the time of a network's step over that of the pooled network, the median over the rounds."""
    return round(float(np.median([seconds[network] / seconds["pooled"] for seconds in rounds])), 2)


def stepping(settings: AsiBipSettings) -> Callable[[], None]:
    """Return a function that does one training step of a network on windows of made-up records."""
    torch.manual_seed(0)
    windows, records = WindowSettings(), made_up_records(BATCH)
    lengths = round(windows.window_s * TV_RATE_HZ), round(windows.window_s * UV_RATE_HZ)
    network = AsiBip(settings, CLASSES, *lengths).train()
    adam = torch.optim.AdamW(network.parameters(), 1e-4, weight_decay=0.0)
    ends = Ends(np.arange(BATCH), np.full(BATCH, 450))
    label = torch.tensor(records.label)

    def step() -> None:
        batch = cut(records, ends, windows)
        loss = focal_loss(network(torch.from_numpy(batch.tv), torch.from_numpy(batch.uv)), label)
        adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()

    return step


def made_up_records(count: int) -> Records:
    """Return records of 5 s of noise; the time of a step does not depend on the values."""
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"label": np.arange(count) % CLASSES})
    tv, uv = (rng.normal(size=(count, 6, round(5 * rate))).astype(np.float32) for rate in (TV_RATE_HZ, UV_RATE_HZ))
    return Records(tv, uv, TV_RATE_HZ, UV_RATE_HZ, table)


def _seconds(step: Callable[[], None], count: int) -> float:
    """Return the mean time of a step over `count` of them, s."""
    begin = time.perf_counter()
    for _ in range(count):
        step()
    return (time.perf_counter() - begin) / count


if __name__ == "__main__":
    print(json_text(run(), 2))
