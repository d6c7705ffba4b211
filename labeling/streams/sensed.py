"""Senses stretches: which parts of each the sensor can follow, and what is known of the TV there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.sensing.following import MOST_SNAPSHOTS
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, TrackUse
from isac_cosim.isacsim.sensing.sensors import Watch
from isac_cosim.isacsim.traffic.motion import even_states, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.streams.stretches import Stretch

NOT_DETECTED = "not_detected"
"""Why the prediction is missing where the sensor should see the TV, and does not find it."""


@dataclass(frozen=True)
class SensedStretch:
    """A stretch as the network knows it.

    state: x, y, vx, vy, ax, ay in m, m/s and m/s2, in the scenario's plane, at tv_rate_hz from `stretch.start_s` on,
    (6, S). truth: the true motion at the same instants, (6, S). n_sites: fewest sites that sensed it at any of them.
    track: of a sensor that does not know who is who, which track stands for the TV; None of others.
    """

    stretch: Stretch
    state: Array
    truth: Array
    n_sites: int
    track: TrackUse | None = None

    @property
    def true(self) -> SensedStretch:
        """The same stretch, with the true motion in place of the sensed one."""
        return replace(self, state=np.ascontiguousarray(self.truth))


@dataclass
class StretchSensing:
    """Senses the stretches of one recording.

    sensor: watches the recording. before_decision_s: how long a TV has to be sensed before its first prediction, s.
    uncovered: number of predictions that could not be made, by reason; it grows while `tracks` is iterated.
    """

    study: DatasetStudy
    recording: Recording
    sensor: Watch
    before_decision_s: float
    uncovered: Counter[str] = field(default_factory=Counter)

    def tracks(self, stretches: Sequence[Stretch]) -> Iterator[SensedStretch]:
        """Yield the tracks of stretches in order, in bounded memory: one for each part of a stretch that is in view."""
        waiting: list[tuple[Stretch, Passage]] = []
        snapshots = 0
        for stretch in stretches:
            for part, passage in self._in_view(stretch):
                count = passage.truth.shape[1]
                if waiting and snapshots + count > MOST_SNAPSHOTS:
                    yield from self._sensed(waiting)
                    waiting, snapshots = [], 0
                waiting.append((part, passage))
                snapshots += count
        yield from self._sensed(waiting)

    def motion_of(self, vehicle: str, start_s: float, count: int, rate_hz: float) -> Array:
        """Return the conditioned states of a vehicle at `count` instants from a time on, (6, count)."""
        track = self.recording.tracks[vehicle]
        return even_states(self.recording, track, start_s, count, rate_hz, self.study.motion)

    def _in_view(self, stretch: Stretch) -> Iterator[tuple[Stretch, Passage]]:
        """Yield the parts of a stretch in which the sensor can follow the TV throughout."""
        rate_hz = self.study.record.tv_rate_hz
        count = round((stretch.end_s - stretch.start_s) * rate_hz) + 1
        truth = self.motion_of(stretch.tv, stretch.start_s, count, rate_hz)
        predicted = 0
        for begin, end in spans(self.sensor.picture.in_view(self._passage(stretch, truth))):
            start_s = stretch.start_s + begin / rate_hz
            # A window ends on the grid of predictions: what is seen before the first whole interval is not used.
            part = stretch.part(start_s, stretch.start_s + (end - 1) / rate_hz, self.before_decision_s)
            if part is not None:
                predicted += len(part.decision_s)
                last = begin + round((part.end_s - start_s) * rate_hz)
                yield part, self._passage(part, truth[:, begin : last + 1])
        self.uncovered[self.sensor.unusable] += len(stretch.decision_s) - predicted

    def _passage(self, stretch: Stretch, truth: Array) -> Passage:
        """Return a stretch in the form that sensors take. The random draws depend on nothing else."""
        key = ("live", self.recording.scenario, self.recording.seed, stretch.tv, f"{stretch.start_s:.6f}")
        find_carrier = partial(self._carrier, stretch, truth.shape[1])
        return Passage(stretch.tv, stretch.start_s, truth, key, acquired=True, find_carrier=find_carrier)

    def _carrier(self, stretch: Stretch, count: int) -> Carrier | None:
        """Return the motion of the UVs of a stretch, each until the next one's first window ends; None without any."""
        if not any(stretch.uv):
            return None
        rate_hz, report, first = self.study.record.tv_rate_hz, self.study.report, 0
        state = np.full((6, count), np.nan)
        for uv, windows in groupby(zip(stretch.uv, stretch.decision_s.tolist(), strict=True), lambda pair: pair[0]):
            last = round((max(time for _, time in windows) - stretch.start_s) * rate_hz)
            track = self.recording.tracks[uv]
            known_s, time_s = self.recording.times(track), stretch.start_s + np.arange(first, last + 1) / rate_hz
            there = (time_s >= known_s[0]) & (time_s <= known_s[-1])
            if there.any():
                state[:, first : last + 1][:, there] = states(self.recording, track, time_s[there], self.study.motion)
            first = last + 1
        uvs = tuple(dict.fromkeys(stretch.uv))
        return Carrier(state, rate_hz, None, report.position_sd_m, report.speed_sd_mps, uvs)

    def _sensed(self, waiting: Sequence[tuple[Stretch, Passage]]) -> Iterator[SensedStretch]:
        """Yield what is known of parts of stretches."""
        records = self.sensor.record([passage for _, passage in waiting])
        for (part, passage), record in zip(waiting, records, strict=True):
            if record.usable:
                state = np.ascontiguousarray(record.state)
                yield SensedStretch(part, state, passage.truth, record.n_sites, record.track)
            else:
                self.uncovered[NOT_DETECTED] += len(part.decision_s)


def spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Return the runs of true values of a mask as pairs (first, after the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
