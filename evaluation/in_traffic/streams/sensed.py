"""Senses stretches: the echoes of every snapshot, the hand-over between panels, and the Kalman filter.

The filter is causal. Filtering many stretches at once therefore gives what a filter gives that is fed fix by fix
(`isacsim.tracking.streaming`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.evaluation.in_traffic.streams.stretches import Stretch
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import blockers_of
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.chain import LEAST_SITES, TOGETHER, Observed, assign, fix
from isac_cosim.isacsim.tracking import kalman
from isac_cosim.isacsim.traffic.motion import even_states
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy

MOST_SNAPSHOTS = 400_000
"""Most snapshots that are filtered at once: their covariances take 50 MB."""
TOO_FEW_SITES = "too_few_sites"
NOT_DETECTED = "not_detected"
"""Reasons why a stretch, or a part of it, is not sensed."""


@dataclass(frozen=True)
class SensedStretch:
    """A stretch as the network knows it.

    state: x, y, vx, vy, ax, ay in m, m/s and m/s2 after the filter, in the scenario's plane, at tv_rate_hz from
    `stretch.start_s` on, (6, S).
    truth: the true motion at the same instants, (6, S). fixes: the input of the filter.
    """

    stretch: Stretch
    state: Array
    truth: Array
    fixes: Observed

    @property
    def true(self) -> SensedStretch:
        """The same stretch, with the true motion in place of the sensed one."""
        return replace(self, state=np.ascontiguousarray(self.truth))


@dataclass
class StretchSensing:
    """Senses the stretches of one recording.

    before_decision_s: how long a TV has to be sensed before its first prediction, s. uncovered: number of predictions
    that could not be made, by reason; it grows while `tracks` is iterated.
    """

    study: DatasetStudy
    scenario: Scenario
    recording: Recording
    before_decision_s: float
    uncovered: Counter[str] = field(default_factory=Counter)

    def tracks(self, stretches: Sequence[Stretch]) -> Iterator[SensedStretch]:
        """Yield the tracks of stretches in order, in bounded memory: one for each part of a stretch that is in view."""
        waiting: list[tuple[Stretch, Array, Observed]] = []
        snapshots = 0
        for stretch in stretches:
            for part, truth in self._in_view(stretch):
                observed = self._observed(part, truth)
                if observed.n_sites < LEAST_SITES:
                    self.uncovered[NOT_DETECTED] += len(part.decision_s)
                    continue
                if waiting and (snapshots + truth.shape[1] > MOST_SNAPSHOTS or len(waiting) == TOGETHER):
                    yield from self._filtered(waiting)
                    waiting, snapshots = [], 0
                waiting.append((part, truth, observed))
                snapshots += truth.shape[1]
        if waiting:
            yield from self._filtered(waiting)

    def motion_of(self, vehicle: str, start_s: float, count: int, rate_hz: float) -> Array:
        """Return the conditioned states of a vehicle at `count` instants from a time on, (6, count)."""
        track = self.recording.tracks[vehicle]
        return even_states(self.recording, track, start_s, count, rate_hz, self.study.motion)

    def _in_view(self, stretch: Stretch) -> Iterator[tuple[Stretch, Array]]:
        """Yield the parts of a stretch in which enough sites see the TV throughout, with its motion."""
        rate_hz, view = self.study.record.tv_rate_hz, self.study.sensing.view
        truth = self.motion_of(
            stretch.tv, stretch.start_s, round((stretch.end_s - stretch.start_s) * rate_hz) + 1, rate_hz
        )
        panels = Panels.of(self.scenario.sites, self.study.sensing.target_height_m)
        seen = (assign(truth[:2].T, rate_hz, panels, view) >= 0).sum(axis=1) >= LEAST_SITES
        predicted = 0
        for begin, end in spans(seen):
            start_s = stretch.start_s + begin / rate_hz
            # A window ends on the grid of predictions: what is seen before the first whole interval is not used.
            part = stretch.part(start_s, stretch.start_s + (end - 1) / rate_hz, self.before_decision_s)
            if part is not None:
                predicted += len(part.decision_s)
                last = begin + round((part.end_s - start_s) * rate_hz)
                yield part, truth[:, begin : last + 1]
        self.uncovered[TOO_FEW_SITES] += len(stretch.decision_s) - predicted

    def _observed(self, part: Stretch, truth: Array) -> Observed:
        """Return the fixes of a part. The random draws depend on the part alone, not on other vehicles."""
        sensing = self.study.sensing
        key = ("live", self.recording.scenario, self.recording.seed, part.tv, f"{part.start_s:.6f}")
        blockers = None
        if sensing.channel.blockage:
            start_s, motion = part.start_s + sensing.tracking.run_in_s, self.study.motion
            blockers = blockers_of(self.recording, start_s, part.end_s, {part.tv}, motion)
        return fix(truth, self.study.record.tv_rate_hz, self.scenario.sites, sensing, key, blockers)

    def _filtered(self, waiting: Sequence[tuple[Stretch, Array, Observed]]) -> Iterator[SensedStretch]:
        """Filter the fixes of several parts together: shorter parts go on without fixes, and are then cut to length."""
        count, length = len(waiting), max(truth.shape[1] for _, truth, _ in waiting)
        fixes = np.zeros((count, length, 4))
        covariances = np.tile(np.eye(4), (count, length, 1, 1))
        valid: BoolArray = np.zeros((count, length), dtype=bool)
        for row, (_, truth, observed) in enumerate(waiting):
            samples = truth.shape[1]
            fixes[row, :samples] = observed.fixes.state
            covariances[row, :samples] = observed.fixes.covariance
            valid[row, :samples] = observed.fixes.valid
        states = kalman.track(
            fixes, covariances, valid, 1 / self.study.record.tv_rate_hz, self.study.sensing.tracking
        ).state
        for row, (part, truth, observed) in enumerate(waiting):
            state = np.ascontiguousarray(states[row, : truth.shape[1]].T)
            yield SensedStretch(part, state, truth, observed)


def spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Return the runs of true values of a mask as pairs (first, after the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
