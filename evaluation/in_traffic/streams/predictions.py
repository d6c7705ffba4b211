"""Predicts sensed tracks: at every decision, a predictor answers the latest window of both streams."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from scipy.special import softmax

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.streams.reports import ReportWindows
from isac_cosim.labeling.streams.sensed import SensedStretch
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.hazards.sight import drive_and_situation, uv_for
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.rule import RuleSettings, logits

BATCH = 512
"""Windows in one batch."""


@dataclass(frozen=True)
class Answers:
    """A predictor's answers to n windows.

    probabilities: of the known intentions, (n, 6). score: the unknown score, (n,): the higher, the better the window
    fits one of the known intentions. features: what the predictor computed from the window, (n, F), if alarms need it.
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


Answering = Callable[[OnMap], Answers]
"""Answers a batch of windows."""


def run_answering(infer: Infer, with_lanes: bool = False, with_uv: bool = True) -> Answering:
    """Return the function by which a trained run answers, the same as on stored records.

    with_lanes: whether those of `drive_and_situation` follow the features of a run that was trained on records.
    with_uv: whether the TVs have a UV; where they have none, the TV takes its place in these features.
    """
    of_streams, shape = infer.run.is_of_streams, infer.run.card.shape

    def answer(windows: OnMap) -> Answers:
        inference = infer.on_roads(windows)
        features = np.empty((len(windows.tv), 0)) if of_streams else inference.features
        if with_lanes and not of_streams:
            tv, uv = windows.tv, windows.uv
            on_map = windows if with_uv else replace(windows, uv=uv_for(tv, uv.shape[2], shape))
            features = np.concatenate([features, drive_and_situation(on_map)[1]], axis=1)
        parts = (inference.probabilities, inference.score, features)
        return Answers(*(np.asarray(part, np.float32) for part in parts))

    return answer


@dataclass(frozen=True)
class AlongAnswering:
    """How a run answers that runs along a stream: whole tracks without cutting windows, or windows."""

    infer: Infer

    def __call__(self, windows: OnMap) -> Answers:
        return run_answering(self.infer)(windows)

    def along(self, track: SensedStretch, cutter: WindowCutter, lanes: LaneMap) -> Answers:
        """Return the answers to all decisions of a track, as to its windows."""
        stretch, shape, step_s = track.stretch, cutter.shape, cutter.decision_s
        ends = np.rint((stretch.decision_s - stretch.start_s) * shape.tv_rate_hz).astype(np.int64)
        parts = []
        for uv, run in groupby(range(len(ends)), lambda k: stretch.uv[k]):
            rows = list(run)
            first_s, last_s = stretch.decision_s[rows[0]], float(stretch.decision_s[rows[-1]])
            at = np.rint((stretch.decision_s[rows] - first_s) / step_s).astype(np.int64)
            tv = track.state[:, ends[rows[0]] + 1 - shape.tv_length : ends[rows[-1]] + 1]
            length = shape.uv_length + round(int(at[-1]) * step_s * shape.uv_rate_hz)
            reports = cutter.reports.window(uv, last_s - cutter.report_delay_s, length)
            inference = self.infer.along(tv, reports, lanes, int(at[-1]) + 1)
            answer = (inference.probabilities[at], inference.score[at], np.empty((len(at), 0)))
            parts.append(Answers(*(np.asarray(part, np.float32) for part in answer)))
        return Answers.joined(parts)


def answering_of(infer: Infer, decision_s: float, with_lanes: bool = False, with_uv: bool = True) -> Answering:
    """Return the function by which a run answers decisions at some interval, s; the rest as in `run_answering`."""
    return AlongAnswering(infer) if infer.steps_s == decision_s else run_answering(infer, with_lanes, with_uv)


def rule_answer(windows: OnMap) -> Answers:
    """Answer as the rule of the road does; its score is that of the strongest intention.

    Its features are those of `drive_and_situation`.
    """
    drive, situation = drive_and_situation(windows)
    strength = logits(drive, RuleSettings())
    parts = (softmax(strength, axis=1), strength.max(axis=1), situation)
    return Answers(*(np.asarray(part, np.float32) for part in parts))


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
