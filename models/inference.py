"""A trained predictor in use: from windows in the scenario's plane to intentions, and whether to trust them."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, Float32Array
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap, in_frame
from isac_cosim.models.hazards.causal import CausalPredictor
from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.scores import open_set
from isac_cosim.models.scores.open_set import Score


@dataclass(frozen=True)
class Inference:
    """The answers to a batch of n windows.

    classes: the known intentions. probabilities: (n, G), calibrated, in the order of `classes`. rejected: (n,), whether
    the window fits none of them. score: the unknown score behind that, (n,), higher where the window fits better.
    features: what the answers rest on, (n, F). latency_ms: time that the whole batch took, with the change of frame.
    """

    classes: tuple[str, ...]
    probabilities: Array
    rejected: BoolArray
    score: Array
    features: Array
    latency_ms: float

    @property
    def intentions(self) -> list[str]:
        """The most probable intention of each window."""
        return [self.classes[k] for k in self.probabilities.argmax(axis=1)]


@dataclass(frozen=True, repr=False)
class Infer:
    """A trained predictor, on the CPU.

    run: the predictor with its card. score: the unknown score by which windows are rejected.
    """

    run: Run
    score: Score

    def __repr__(self) -> str:
        return f"<Infer {repr(self.run)[5:]}"

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load it from a run's folder. Raises InputError if it is not a finished run."""
        run = load_run(path)
        return cls(run, open_set.chosen(run))

    def __call__(self, tv: Array | Float32Array, uv: Array | Float32Array, lanes: LaneMap | None = None) -> Inference:
        """Answer one window, (6, T) and (6, U), or a batch, (n, 6, T) and (n, 6, U), in the scenario's plane.

        Both streams end at the same instant. lanes: those of the road network, for predictors that look at lanes.
        Without lanes, and unless the frame of the run is absolute, positions may be relative to any point, as datasets
        store them.
        Raises ValueError if the shapes are not those that the predictor was trained on.
        """
        tv, uv = (np.asarray(x, dtype=np.float64) for x in (tv, uv))
        if tv.ndim == 2:
            tv, uv = tv[None], uv[None]
        on_map = None if lanes is None else OnMap.in_one(tv, uv, self.run.card.tv_rate_hz, lanes)
        return self._answered(tv, uv, on_map)

    def on_roads(self, windows: OnMap) -> Inference:
        """Answer a batch of windows on their roads. Raises ValueError as `__call__`."""
        return self._answered(windows.tv, windows.uv, windows)

    def _answered(self, tv: Array, uv: Array, on_map: OnMap | None) -> Inference:
        begin = time.perf_counter()
        card = self.run.card
        if tv.shape[1:] != (6, card.tv_length) or uv.shape != (len(tv), 6, card.uv_length):
            raise ValueError(
                f"windows of shapes {tv.shape} and {uv.shape}; trained on {card.tv_length} and {card.uv_length}"
            )
        windows = in_frame(tv, uv, card.settings.windows, card.tv_rate_hz, card.uv_rate_hz)
        return self._inferred(self.run.answer(replace(windows, on_map=on_map)), begin)

    @property
    def steps_s(self) -> float | None:
        """The time between two decisions along a stream, s, of a run that need not cut windows; None of others."""
        predictor = self.run.predictor
        return predictor.facts.decision_s if isinstance(predictor, CausalPredictor) else None

    def along(self, tv: Array, uv: Array, lanes: LaneMap, decisions: int) -> Inference:
        """Answer the last decisions along a stream, as on the windows that end there, without cutting them.

        tv, uv: (6, T) and (6, U), in the scenario's plane, from the beginning of the first window on, up to the same
        instant. Raises ValueError if the run needs windows, or the streams do not hold the first one.
        """
        begin = time.perf_counter()
        predictor, card = self.run.predictor, self.run.card
        if not isinstance(predictor, CausalPredictor):
            raise ValueError(f"{card.settings.model} answers windows")
        for states, length, samples in zip((tv, uv), (card.tv_length, card.uv_length), predictor.samples, strict=True):
            if states.shape[1] < length + (decisions - 1) * samples:
                raise ValueError(f"streams of {tv.shape[1]} and {uv.shape[1]} samples for {decisions} decisions")
        on_map = OnMap.in_one(tv[None], uv[None], card.tv_rate_hz, lanes)
        return self._inferred(predictor.along(on_map, decisions).finite(self.run.path), begin)

    def _inferred(self, outputs: Outputs, begin: float) -> Inference:
        card = self.run.card
        threshold = -np.inf if card.unknown_threshold is None else card.unknown_threshold
        score = self.score(outputs)
        probabilities = replace(outputs, logits=outputs.logits / card.temperature).probabilities
        latency_ms = 1000 * (time.perf_counter() - begin)
        return Inference(card.classes, probabilities, score < threshold, score, outputs.features, latency_ms)
