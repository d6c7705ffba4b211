"""The time that a network takes for a window: change of frame, network, probabilities, on one thread.

The networks have their default sizes and random weights, on which the time does not depend. The reference is ASI-BIP
with every LSTM output as a token.

Run: python -m isac_cosim.benchmarks.infer
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from isac_cosim.base.files import json_text
from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.benchmarks.train import CLASSES, TV_RATE_HZ, UV_RATE_HZ
from isac_cosim.models.data.windows import WindowSettings, in_frame
from isac_cosim.models.predictors.aligned import AlignedPredictor
from isac_cosim.models.predictors.asi_bip import AsiBip, AsiBipPredictor, AsiBipSettings
from isac_cosim.models.predictors.castformer import CastformerPredictor
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.runs.settings import TrainSettings

ROUNDS, BATCH = 15, 64
RATIOS = (
    Ratio(("ratio",), "time of a window with every LSTM output a token over pooled tokens", "the LSTMs' 880 steps"),
)


def run() -> dict[str, Any]:
    """Return `ratio` (literal over pooled ASI-BIP), and by network `window_ms`, alone and within a batch."""
    with torch_threads(1):
        return _measured()


def predictors() -> dict[str, NetworkPredictor]:
    """Return untrained networks of default size for the default window, and the literal reading of ASI-BIP."""
    torch.manual_seed(0)
    settings = TrainSettings()
    tv, uv = (round(settings.windows.window_s * rate) for rate in (TV_RATE_HZ, UV_RATE_HZ))
    shape = WindowShape(CLASSES, tv, uv, TV_RATE_HZ, UV_RATE_HZ)
    return {
        "asi-bip": AsiBipPredictor(AsiBipPredictor.build(settings, shape).eval()),
        "asi-bip literal": AsiBipPredictor(AsiBip(AsiBipSettings(tokens="literal"), CLASSES, tv, uv).eval()),
        "castformer": CastformerPredictor(CastformerPredictor.build(settings, shape).eval()),
        "aligned": AlignedPredictor(AlignedPredictor.build(settings, shape).eval()),
    }


def _measured() -> dict[str, Any]:
    by_name = predictors()
    alone = {name: answering(predictor, 1) for name, predictor in by_name.items()}
    together = {name: answering(predictor, BATCH) for name, predictor in by_name.items()}
    # The networks take turns, so that other load on the machine slows all of them.
    rounds = [{name: _milliseconds(answer) for name, answer in alone.items()} for _ in range(ROUNDS)]
    window_ms = {name: round(float(np.median([r[name] for r in rounds])), 3) for name in by_name}
    ratios = [r["asi-bip literal"] / r["asi-bip"] for r in rounds]
    return {
        "ratio": round(float(np.median(ratios)), 2),
        "ratio_of": "milliseconds of one window with every LSTM output a token over those with pooled tokens",
        "window_ms": window_ms,
        "window_ms_of_a_batch": {name: round(_milliseconds(answer) / BATCH, 3) for name, answer in together.items()},
        "parameters": {name: predictor.network.parameter_count for name, predictor in by_name.items()},
        "settings": {"window_s": WindowSettings().window_s, "batch": BATCH, "rounds": ROUNDS, "threads": 1},
    }


def answering(predictor: NetworkPredictor, count: int) -> Callable[[], object]:
    """Return a function that answers `count` windows in the scenario's plane; it is called once, to warm up."""
    settings, rng = WindowSettings(), np.random.default_rng(0)
    tv, uv = (rng.normal(size=(count, 6, round(settings.window_s * rate))) for rate in (TV_RATE_HZ, UV_RATE_HZ))

    def answer() -> object:
        return predictor(in_frame(tv, uv, settings, TV_RATE_HZ, UV_RATE_HZ)).probabilities

    answer()
    return answer


def _milliseconds(answer: Callable[[], object]) -> float:
    """Return the time of a call, ms."""
    begin = time.perf_counter()
    answer()
    return 1000 * (time.perf_counter() - begin)


if __name__ == "__main__":
    print(json_text(run(), 2))
