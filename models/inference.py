"""A trained predictor at work: windows in the scenario's plane in, intentions and whether to believe them out."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from models.data.lane_map import LaneMap
from models.data.windows import OnMap, in_frame
from models.run import Run, load_run
from models.scores import open_set
from models.scores.open_set import Score


@dataclass(frozen=True)
class Inference:
    """What was said of a batch of windows.

    probabilities: (n, G), calibrated, in the order of `classes`. rejected: (n,), the window fits none of them.
    latency_ms: of the whole batch, frame change included.
    """

    classes: tuple[str, ...]
    probabilities: npt.NDArray[np.float64]
    rejected: npt.NDArray[np.bool_]
    latency_ms: float

    @property
    def intentions(self) -> list[str]:
        """The most probable intention of each window."""
        return [self.classes[k] for k in self.probabilities.argmax(axis=1)]


@dataclass(frozen=True)
class Infer:
    """Answers windows on the CPU."""

    run: Run
    score: Score

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """From a run's folder. InputError where it is none."""
        run = load_run(path)
        return cls(run, open_set.chosen(run))

    def __call__(
        self, tv: npt.NDArray[np.floating], uv: npt.NDArray[np.floating], lanes: LaneMap | None = None
    ) -> Inference:
        """Answer one window, (6, T) and (6, U), or a batch, (n, 6, T) and (n, 6, U), in the scenario's plane.

        Both streams end at the same instant. lanes: of the road network, which the rule needs, other predictors do not.
        ValueError where shapes are not those that the predictor was trained on.
        """
        begin = time.perf_counter()
        card = self.run.card
        tv, uv = (np.asarray(x, dtype=np.float64) for x in (tv, uv))
        if tv.ndim == 2:
            tv, uv = tv[None], uv[None]
        if tv.shape[1:] != (6, card.tv_length) or uv.shape != (len(tv), 6, card.uv_length):
            raise ValueError(
                f"windows of shapes {tv.shape} and {uv.shape}; trained on {card.tv_length} and {card.uv_length}"
            )
        windows = in_frame(tv, uv, card.settings.windows, card.tv_rate_hz, card.uv_rate_hz)
        if lanes is not None:
            here = np.full(len(tv), "here", dtype=object)
            windows = replace(windows, on_map=OnMap(tv, uv, card.tv_rate_hz, here, lambda _: lanes))
        outputs = self.run.predictor(windows)
        threshold = -np.inf if card.unknown_threshold is None else card.unknown_threshold
        rejected = self.score(outputs) < threshold
        probabilities = softmax(outputs.logits / card.temperature, axis=1)
        return Inference(card.classes, probabilities, rejected, 1000 * (time.perf_counter() - begin))
