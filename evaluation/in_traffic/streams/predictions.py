"""Predicts sensed tracks: at every decision, a predictor answers the latest window of both streams."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from scipy.special import softmax

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.evaluation.in_traffic.streams.sensed import SensedStretch, StretchSensing
from isac_cosim.evaluation.in_traffic.streams.situation import situation
from isac_cosim.isacsim.sensing.reports import report
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.lane_motion import LaneMotion
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.rule import Drive, RuleSettings, drive_on, in_lane, logits

BATCH = 128
"""Windows in one batch."""
REPORTS_KEPT = 128
"""Vehicles whose reports stay in memory: a vehicle is often the UV of several TVs in turn."""


@dataclass(frozen=True)
class Answers:
    """A predictor's answers to n windows.

    probabilities: of the known intentions, (n, 6). score: the unknown score, (n,): the higher, the better the window
    fits one of the known intentions. features: what the predictor computed from the window, (n, F).
    """

    probabilities: Float32Array
    score: Float32Array
    features: Float32Array

    @classmethod
    def joined(cls, parts: Sequence[Answers]) -> Answers:
        """Return the answers to several batches as one."""
        names = ("probabilities", "score", "features")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, rows: IntArray) -> Answers:
        """Return the answers in some rows, in the order of `rows`."""
        return Answers(self.probabilities[rows], self.score[rows], self.features[rows])


@dataclass(frozen=True)
class LiveWindows:
    """Windows in the scenario's plane, tv (n, 6, T) and uv (n, 6, U), and the lanes of the network."""

    tv: Array
    uv: Array
    tv_rate_hz: float
    lanes: LaneMap

    @cached_property
    def drive(self) -> Drive:
        """What the rule of the road sees of the windows."""
        return drive_on(self._on_map, RuleSettings().smooth_s, self._motion)

    @cached_property
    def situation(self) -> Float32Array:
        """What the lanes and the UV say about the windows: `in_lane`, then `situation`, (n, F)."""
        parts = in_lane(self.drive), situation(self._on_map, self._motion)
        return np.concatenate(parts, axis=1).astype(np.float32)

    @cached_property
    def _on_map(self) -> OnMap:
        scenario = np.full(len(self.tv), "", dtype=object)
        return OnMap(self.tv, self.uv, self.tv_rate_hz, scenario, lambda _: self.lanes)

    @cached_property
    def _motion(self) -> LaneMotion:
        return LaneMotion.of(self._on_map, RuleSettings().smooth_s)


Answering = Callable[[LiveWindows], Answers]
"""Answers a batch of windows."""


def run_answering(infer: Infer, with_lanes: bool = False) -> Answering:
    """Return the function by which a trained run answers, the same as on stored records.

    with_lanes: whether those of `LiveWindows.situation` follow the features of the run.
    """

    def answer(windows: LiveWindows) -> Answers:
        inference = infer(windows.tv, windows.uv, windows.lanes)
        features = inference.features
        if with_lanes:
            features = np.concatenate([features, windows.situation], axis=1)
        parts = (inference.probabilities, inference.score, features)
        return Answers(*(np.asarray(part, np.float32) for part in parts))

    return answer


def rule_answer(windows: LiveWindows) -> Answers:
    """Answer as the rule of the road does; its score is that of the strongest intention.

    Its features are those of `LiveWindows.situation`.
    """
    strength = logits(windows.drive, RuleSettings())
    parts = (softmax(strength, axis=1), strength.max(axis=1), windows.situation)
    return Answers(*(np.asarray(part, np.float32) for part in parts))


class Reports:
    """The reports of the vehicles of a recording, at the rate and with the noise of the study.

    A vehicle has a single stream of reports, whichever TV it is the UV of.
    """

    def __init__(self, sensing: StretchSensing) -> None:
        self._sensing = sensing
        self._of = lru_cache(maxsize=REPORTS_KEPT)(self._stream)

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        """Return the last `length` reports of a vehicle up to a time (s), (6, length).

        Raises ValueError if the vehicle has not reported throughout.
        """
        first, states = self._of(vehicle)
        last = round(end_s * self._sensing.study.record.uv_rate_hz) - first
        if last + 1 < length or last >= states.shape[1]:
            raise ValueError(f"vehicle {vehicle} has not reported throughout the window that ends at {end_s:.3f} s")
        return states[:, last + 1 - length : last + 1]

    def _stream(self, vehicle: str) -> tuple[int, Array]:
        """Return the number of a vehicle's first report, in intervals since time 0, and all its reports, (6, n)."""
        recording, study = self._sensing.recording, self._sensing.study
        track, rate_hz = recording.tracks[vehicle], study.record.uv_rate_hz
        first_s, last_s = track.first_step * recording.step_s, (track.first_step + len(track) - 1) * recording.step_s
        first, last = int(np.ceil(first_s * rate_hz - 1e-6)), int(np.floor(last_s * rate_hz + 1e-6))
        states = self._sensing.motion_of(vehicle, first / rate_hz, last - first + 1, rate_hz)
        key = ("live", recording.scenario, recording.seed, vehicle)
        return first, report(states, study.report, key)


class ReportWindows(Protocol):
    """A source of the UV's part of a window."""

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        """Return the last `length` reports of a vehicle up to a time (s), (6, length)."""


class NoReports:
    """Stands for a missing UV: it rests at the origin, so that the axes of a window follow the TV's travel."""

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        return np.zeros((6, length))


@dataclass(frozen=True)
class WindowCutter:
    """Cuts windows out of tracks.

    reports: those of the UVs. shape: lengths and rates of a window. report_delay_s: age of the newest report at the end
    of a window, s. decision_s: time between the ends of two windows, s.
    """

    reports: ReportWindows
    study: DatasetStudy
    shape: WindowShape
    report_delay_s: float
    decision_s: float

    def batches(self, track: SensedStretch) -> Iterator[tuple[Array, Array]]:
        """Yield the windows of a track in order, TV (n, 6, T) and UV (n, 6, U), at most BATCH at a time."""
        stretch, shape = track.stretch, self.shape
        ends = np.rint((stretch.decision_s - stretch.start_s) * shape.tv_rate_hz).astype(np.int64)
        sliding = np.lib.stride_tricks.sliding_window_view(track.state, shape.tv_length, axis=1)
        for k in range(0, len(ends), BATCH):
            part = slice(k, k + BATCH)
            tv = sliding[:, ends[part] + 1 - shape.tv_length].transpose(1, 0, 2)
            pairs = zip(stretch.uv[part], stretch.decision_s[part].tolist(), strict=True)
            uv = [self.reports.window(name, time - self.report_delay_s, shape.uv_length) for name, time in pairs]
            yield tv, np.stack(uv)


def lanes_of(recording: Recording) -> LaneMap:
    """Return the lanes of a recording's network."""
    return LaneMap.of(recording.lanes)
