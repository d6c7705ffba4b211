"""What the network knows while traffic runs: sensed TVs, the reports of UVs, and a predictor's answers about both."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.in_traffic.streams.predictions import Answering, Answers
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.passages import Piece
from isac_cosim.isacsim.sensing.reports import report
from isac_cosim.isacsim.sensing.sensors import Watch
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import Pair, choose_uv, may_be_tv
from isac_cosim.labeling.streams.stretches import Timing
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.predictors.protocol import WindowShape


@dataclass(frozen=True)
class Knowledge:
    """What the network knows at an instant of the world's clock.

    time_s: s. tv, uv: the pairs whose window is complete, B names each. windows: of the TV, (B, 6, T), and of the UV,
    (B, 6, U), in the scenario's plane. answers: of the predictor to them, None without one. surroundings: who is in
    which lane. uv_of: the connected leader of each vehicle that has one. reported: the newest report of each vehicle
    that has arrived, x, y, vx, vy, ax, ay, (6,); the network gets those of connected vehicles.
    """

    time_s: float
    tv: tuple[str, ...]
    uv: tuple[str, ...]
    windows: tuple[Array, Array]
    answers: Answers | None
    surroundings: Surroundings
    uv_of: Mapping[str, str]
    reported: Mapping[str, Array]


@dataclass
class Network:
    """Watches TVs by the rule of the open loop: the UV of a window is the connected leader when the window begins.

    A TV is sensed while it has a connected leader, and for the length of a window after. The newest report of a UV is
    `timing.report_delay_s` old at the end of a window. answering: None where nothing is predicted.
    """

    scenario: Scenario
    seed: int
    study: DatasetStudy
    shape: WindowShape
    timing: Timing
    sensor: Watch
    answering: Answering | None
    _tv: dict[str, Array] = field(default_factory=dict)
    _uv: dict[str, Array] = field(default_factory=dict)
    _sensed_until: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._graph = LaneGraph(self.scenario.lanes, self.scenario.lefthand)
        self._lanes = LaneMap.of(self.scenario.lanes)
        per_window = round(self.timing.window_s / self.timing.decision_s)
        self._pairs: deque[Mapping[str, str]] = deque(maxlen=per_window + 1)
        self._last_uv: dict[str, str] = {}
        self._enough = round(self.timing.before_decision_s * self.shape.tv_rate_hz)
        self._delay = round(self.timing.report_delay_s * self.shape.uv_rate_hz)

    def learn(self, piece: Piece) -> Knowledge:
        """Take in the next piece of the world."""
        surroundings = Surroundings(piece.lanes, self._graph)
        pairs = self._paired(surroundings, piece)
        self._pairs.append({tv: pair.uv for tv, pair in pairs.items()})
        self._listen(piece)
        sensed = self.sensor.step(piece, self._watched(piece.end_s))
        self._tv = {
            name: _joined(self._tv.get(name), state, self._enough + 1)
            for name, state in zip(sensed.names, sensed.state, strict=True)
        }
        tv, uv = self._ready()
        windows = self._windows(tv, uv)
        answers = None
        if self.answering and tv:
            answers = self.answering(OnMap.in_one(*windows, self.shape.tv_rate_hz, self._lanes))
        reported = {
            name: states[:, -1 - self._delay] for name, states in self._uv.items() if states.shape[1] > self._delay
        }
        return Knowledge(piece.end_s, tv, uv, windows, answers, surroundings, self._pairs[-1], reported)

    def _paired(self, surroundings: Surroundings, piece: Piece) -> dict[str, Pair]:
        settings = self.study.pairs
        pairs = {}
        for name, track in piece.lanes.tracks.items():
            if may_be_tv(track, settings):
                pair = choose_uv(surroundings, name, piece.end_s + settings.before_onset_s, settings)
                if pair is not None:
                    pairs[name] = pair
        return pairs

    def _watched(self, time_s: float) -> dict[str, str]:
        """Return the TVs to sense now, each with its present or latest UV."""
        for tv, uv in self._pairs[-1].items():
            self._sensed_until[tv] = time_s + self.timing.window_s
            self._last_uv[tv] = uv
        self._sensed_until = {tv: until for tv, until in self._sensed_until.items() if until >= time_s - 1e-9}
        self._last_uv = {tv: self._last_uv[tv] for tv in self._sensed_until}
        return self._last_uv

    def _listen(self, piece: Piece) -> None:
        """Keep the reports of all vehicles that are some TV's UV, or may have been."""
        length = self.shape.uv_length + self._delay
        key = (self.scenario.name, self.seed, f"{piece.end_s:.6f}")
        self._uv = {
            name: _joined(self._uv.get(name), self._report(state, (*key, name)), length)
            for name, state in zip(piece.names, piece.uv, strict=True)
        }

    def _report(self, state: Array, key: tuple[str | int, ...]) -> Array:
        """Return what a vehicle reports over a piece, (6, m)."""
        return report(state, self.study.report, ("live", *key))

    def _ready(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the TVs that have been sensed long enough, and the UV of each."""
        if len(self._pairs) < (self._pairs.maxlen or 0):
            return (), ()
        length = self.shape.uv_length + self._delay
        ready = [
            (tv, uv)
            for tv, uv in self._pairs[0].items()
            if tv in self._tv
            and self._tv[tv].shape[1] >= self._enough
            and uv in self._uv
            and self._uv[uv].shape[1] == length
        ]
        return tuple(tv for tv, _ in ready), tuple(uv for _, uv in ready)

    def _windows(self, tv: tuple[str, ...], uv: tuple[str, ...]) -> tuple[Array, Array]:
        shape = self.shape
        if not tv:
            return np.empty((0, 6, shape.tv_length)), np.empty((0, 6, shape.uv_length))
        tv_windows = np.stack([self._tv[name][:, -shape.tv_length :] for name in tv])
        uv_windows = np.stack([self._uv[name][:, : shape.uv_length] for name in uv])
        return tv_windows, uv_windows


def _joined(before: Array | None, state: Array, most: int) -> Array:
    """Return states with the newest appended, at most so many of them, (6, n)."""
    return state if before is None else np.concatenate([before, state], axis=1)[:, -most:]
