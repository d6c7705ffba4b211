"""What one window costs a predictor: frame change, network, probabilities, on one thread.

Networks have their default sizes and random weights: how long an answer takes does not depend on them. The reference is
ASI-BIP with every LSTM output a token.

Run: python -m benchmarks.infer
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from benchmarks.train import CLASSES, TV_RATE_HZ, UV_RATE_HZ
from models.data.windows import WindowSettings, in_frame
from models.predictors.asi_bip import AsiBip, AsiBipSettings
from models.predictors.castformer import Castformer, CastformerSettings
from models.predictors.floors import Aligned, AlignedSettings
from models.predictors.network import WindowNetwork
from models.run import NetworkPredictor

ROUNDS, BATCH = 15, 64


def run() -> dict[str, Any]:
    """Measure; keys `ratio` (literal over pooled ASI-BIP), `window_ms` alone and of a batch, by network."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _measured()
    finally:
        torch.set_num_threads(threads)


def networks() -> dict[str, WindowNetwork]:
    """Untrained networks of default size for the default window, and the literal reading of ASI-BIP."""
    torch.manual_seed(0)
    tv, uv = (round(WindowSettings().window_s * rate) for rate in (TV_RATE_HZ, UV_RATE_HZ))
    return {
        "asi-bip": AsiBip(AsiBipSettings(), CLASSES, tv, uv),
        "asi-bip literal": AsiBip(AsiBipSettings(tokens="literal"), CLASSES, tv, uv),
        "castformer": Castformer(CastformerSettings(), CLASSES, tv, uv, TV_RATE_HZ, UV_RATE_HZ),
        "aligned": Aligned(AlignedSettings(), CLASSES),
    }


def _measured() -> dict[str, Any]:
    found = networks()
    alone = {name: answering(network, 1) for name, network in found.items()}
    together = {name: answering(network, BATCH) for name, network in found.items()}
    # All networks take turns, so that a busy machine slows all of them.
    rounds = [{name: _milliseconds(answer) for name, answer in alone.items()} for _ in range(ROUNDS)]
    window_ms = {name: round(float(np.median([r[name] for r in rounds])), 3) for name in found}
    ratios = [r["asi-bip literal"] / r["asi-bip"] for r in rounds]
    return {
        "ratio": round(float(np.median(ratios)), 2),
        "ratio_of": "milliseconds of one window with every LSTM output a token over those with pooled tokens",
        "window_ms": window_ms,
        "window_ms_of_a_batch": {name: round(_milliseconds(each) / BATCH, 3) for name, each in together.items()},
        "parameters": {name: network.parameter_count for name, network in found.items()},
        "settings": {"window_s": WindowSettings().window_s, "batch": BATCH, "rounds": ROUNDS, "threads": 1},
    }


def answering(network: WindowNetwork, count: int) -> Callable[[], object]:
    """One answer to `count` windows in the scenario's plane; called once, to warm up."""
    settings, rng = WindowSettings(), np.random.default_rng(0)
    tv, uv = (rng.normal(size=(count, 6, round(settings.window_s * rate))) for rate in (TV_RATE_HZ, UV_RATE_HZ))
    predictor = NetworkPredictor(network.eval())

    def answer() -> object:
        return predictor(in_frame(tv, uv, settings, TV_RATE_HZ, UV_RATE_HZ)).probabilities

    answer()
    return answer


def _milliseconds(answer: Callable[[], object]) -> float:
    begin = time.perf_counter()
    answer()
    return 1000 * (time.perf_counter() - begin)


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
