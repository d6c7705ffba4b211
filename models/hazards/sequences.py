"""Streams as sequences of steps, for networks that run along them: every decision, with nothing drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from torch.utils.data import TensorDataset

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.intentions import outward
from isac_cosim.labeling.streams.store import StoredStretch, StreamFacts
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.blocks import steps_of
from isac_cosim.models.hazards.decisions import StreamSide, by_vehicle
from isac_cosim.models.hazards.sight import samples_of, uv_for
from isac_cosim.models.hazards.targets import Targets, targets_of


@dataclass(frozen=True)
class Sequences:
    """Sequences of equal length, each with the steps before its first decision that the answer may rest on.

    steps: (n, K - 1 + L, F), for windows of K steps. targets: of the L decisions, IGNORED where there is none:
    interval (n, L, 5) and passing (n, L).
    """

    steps: Float32Array
    targets: Targets

    def __len__(self) -> int:
        return len(self.steps)

    def items(self) -> TensorDataset:
        """Return the sequences for torch: steps, interval, passing, and weights, which are all 1."""
        arrays = self.steps, self.targets.interval, self.targets.passing
        return TensorDataset(*map(torch.from_numpy, arrays), torch.ones(self.targets.passing.shape))

    @classmethod
    def of(cls, side: StreamSide, length: int, feedback: Feedback, title: str) -> Self:
        """Read the streams of a side. Raises InputError if it has no decision."""
        parts: list[Segment] = []
        with feedback.bar(title, "episodes") as move:
            for done, (facts, stretches) in enumerate(side.streams.read(side.episodes), start=1):
                events = by_vehicle(facts.events)
                change_out = outward(side.lane_maps(facts.scenario).lefthand)
                for stretch in stretches:
                    of_tv = events.get(stretch.tv_id, [])
                    targets = targets_of(of_tv, stretch.decision_s, side.settings.horizons_s, change_out)
                    for segment in _segments(side, facts, stretch, targets):
                        parts += _chunks(*segment, length)
                move(done, len(side.episodes))
        if not parts:
            raise InputError(f"{side.streams.path}: no decision to train on; generate more streams")
        steps, interval, passing = (np.stack(part) for part in zip(*parts, strict=True))
        return cls(steps.astype(np.float32), Targets(interval, passing))


Segment = tuple[Float32Array, IntArray, IntArray]
"""Steps (K - 1 + L, F) with the answers to the L last ones, interval (L, 5) and passing (L,)."""


def _segments(side: StreamSide, facts: StreamFacts, stretch: StoredStretch, targets: Targets) -> Iterator[Segment]:
    """Yield the steps and answers along each segment of a stretch, in which the UV stays the same."""
    shape, step_s = side.shape, facts.decision_s
    samples = samples_of(shape, step_s)
    before = shape.tv_length // samples[0]
    delay_s = side.streams.meta.settings.stretches.report_delay_s
    for number in range(len(stretch.uv)):
        rows = np.flatnonzero(stretch.segment == number)
        if not len(rows):
            continue
        at = np.rint((stretch.decision_s[rows] - stretch.decision_s[rows[0]]) / step_s).astype(np.int64)
        count, last_s = before + int(at[-1]), float(stretch.decision_s[rows[-1]])
        tv_last = round((last_s - stretch.start_s) * shape.tv_rate_hz)
        uv_last = round((last_s - delay_s) * shape.uv_rate_hz) - stretch.uv_first[number]
        states = stretch.tv_truth if side.settings.truth else stretch.tv
        tv = in_plane(states[:, tv_last + 1 - count * samples[0] : tv_last + 1], *stretch.point)
        uv = in_plane(stretch.uv[number][:, uv_last + 1 - count * samples[1] : uv_last + 1], *stretch.point)
        if not side.settings.uv:
            uv = uv_for(tv[None], uv.shape[1], shape)[0]
        scenario = np.full(1, facts.scenario, dtype=object)
        on_map = OnMap(tv[None], uv[None], shape.tv_rate_hz, scenario, side.lane_maps)
        interval = np.full((int(at[-1]) + 1, len(WITH_HAZARD)), IGNORED, np.int64)
        passing = np.full(len(interval), IGNORED, np.int64)
        interval[at], passing[at] = targets.interval[rows], targets.passing[rows]
        yield steps_of(on_map, samples, side.settings.lanes)[0], interval, passing


def _chunks(steps: Float32Array, interval: IntArray, passing: IntArray, length: int) -> list[Segment]:
    """Cut a segment into chunks of L decisions; the last is filled up with steps that have no answer."""
    before = len(steps) - len(interval)
    missing = -len(interval) % length
    steps = np.concatenate([steps, np.repeat(steps[-1:], missing, axis=0)])
    interval = np.concatenate([interval, np.full((missing, len(WITH_HAZARD)), IGNORED)])
    passing = np.concatenate([passing, np.full(missing, IGNORED)])
    return [
        (steps[k : k + before + length], interval[k : k + length], passing[k : k + length])
        for k in range(0, len(interval), length)
    ]
