"""Turns the answers to consecutive windows into alarms: the rule, and all alarms of a whole episode.

An answer gives each intention a level: the higher, the more it speaks for that intention. The k-th highest of the last
n levels is the confirmed level; levels from before a pause do not count. An alarm is raised when the confirmed level
rises to the intention's threshold, unless the vehicle had an alarm of that intention too soon before. A level that
stays above the threshold can rise anew: it falls from a peak, and rises from the lowest point after it, each time by as
much as the settings say.

What those words mean is stated once, in `is_pause`, `confirm`, `is_too_soon` and `Swing`. A whole episode is done at
once here; `evaluation.in_traffic.alarms.stream` applies the same rule answer by answer, and is the reference in the
tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import overload

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, Float32Array, IntArray
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.evaluation.in_traffic.streams.store import LiveEpisode
from isac_cosim.labeling.intentions import KNOWN

NEVER = -np.inf
"""The level of an intention for which a window cannot raise an alarm."""
SLACK_S = 1e-9
"""Times that differ by less are the same, s."""
LEAST_PROBABILITY = 1e-6
"""The log-odds of what is less likely, or less unlikely, are not told apart."""


def is_pause(gap_s: Array | float, decision_s: float) -> BoolArray:
    """Return whether predictions of a vehicle are so far apart, s, that the later one begins anew."""
    return np.asarray(np.asarray(gap_s) > 1.5 * decision_s)


def confirm(recent: Float32Array, k: int) -> Float32Array:
    """Return the confirmed level of some of the latest levels, (m, ...): the k-th highest; NEVER if they are fewer."""
    if len(recent) < k:
        return np.full(recent.shape[1:], NEVER, np.float32)
    return np.asarray(np.sort(recent, axis=0)[-k])


@overload
def is_too_soon(gap_s: float, refractory_s: float) -> bool: ...
@overload
def is_too_soon(gap_s: Array, refractory_s: float) -> BoolArray: ...
def is_too_soon(gap_s: Array | float, refractory_s: float) -> BoolArray | bool:
    """Return whether an alarm comes too soon after the one before, s, of the same vehicle and intention."""
    return gap_s < refractory_s - SLACK_S


@dataclass
class Swing:
    """Follows how levels fall and rise, from one prediction to the next; it begins anew at a pause.

    rise: by how much a level has to fall from its peak, and to rise after that. peak, trough: the highest level since
    the last rise, and the lowest after a fall from it, (...). fallen: whether the level has fallen since, (...).
    """

    rise: float
    peak: Float32Array
    trough: Float32Array
    fallen: BoolArray

    @classmethod
    def at(cls, level: Float32Array, rise: float) -> Swing:
        """Begin with a level, (...)."""
        return cls(rise, level.copy(), level.copy(), np.zeros(level.shape, dtype=bool))

    def step(self, level: Float32Array) -> Float32Array:
        """Take the next level; return the trough from which it has just risen anew, NEVER where it has not, (...)."""
        risen = self.fallen & (level >= self.trough + np.float32(self.rise))
        rose_from = np.where(risen, self.trough, np.float32(NEVER))
        self.peak = np.where(risen, level, np.maximum(self.peak, level))
        falls = ~self.fallen & (level <= self.peak - np.float32(self.rise))
        self.trough = np.where(self.fallen, np.minimum(self.trough, level), level)
        self.fallen = (self.fallen & ~risen) | falls
        return rose_from


@dataclass(frozen=True)
class Rises:
    """Where the levels of an intention rise, in n predictions, the lowest first: what an alarm may begin with.

    rows: numbers of the predictions, (n,). level, before: the level there and at the prediction before, NEVER before
    the first one after a pause, (n,). rose_from: as `Levels.rose_from`, (n,).
    """

    rows: IntArray
    level: Array
    before: Array
    rose_from: Array

    @classmethod
    def of(cls, level: Float32Array, begins: BoolArray, rose_from: Float32Array | None) -> Rises:
        """Find them in the levels of one intention, (n,). rose_from: None where a level that stays on never re-arms."""
        before = np.full(len(level), NEVER, np.float32)
        before[1:] = np.where(begins[1:], np.float32(NEVER), level[:-1])
        rose_from = np.full(len(level), NEVER, np.float32) if rose_from is None else rose_from
        rows = np.flatnonzero((level > before) | (rose_from > NEVER))
        rows = rows[np.argsort(level[rows], kind="stable")]
        return cls(rows, *(column[rows].astype(np.float64) for column in (level, before, rose_from)))

    def at(self, threshold: float) -> IntArray:
        """Return the predictions at which the level rises to a threshold, or anew above it, in order, (m,)."""
        first = int(np.searchsorted(self.level, threshold))
        rises = (self.before[first:] < threshold) | (self.rose_from[first:] >= threshold)
        return np.sort(self.rows[first:][rises])


@dataclass(frozen=True)
class Levels:
    """The levels of the n predictions of one episode, vehicle by vehicle, in order of time.

    level: of each prediction and intention, (n, 6). vehicle: number of the vehicle, (n,). time_s: end of the window,
    (n,). begins: whether the prediction is the first of its vehicle, or the first after a pause, (n,). asked: numbers
    of the intentions that alarms are raised for, rising.
    """

    level: Float32Array
    vehicle: IntArray
    time_s: Array
    begins: BoolArray
    asked: tuple[int, ...] = tuple(range(len(KNOWN)))
    # Many thresholds are tried on the same levels, for several choices of intentions.
    _rises: dict[tuple[int, float | None], Rises] = field(default_factory=dict, init=False, repr=False, compare=False)
    _rose_from: dict[float, Float32Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, episode: LiveEpisode, level: Float32Array) -> Levels:
        """Return the levels (n, 6) of an episode's predictions."""
        return cls(level, episode.vehicle, episode.time_s, pauses(episode))

    def asking(self, intentions: Sequence[int] | None) -> Levels:
        """Return the same levels for alarms of some intentions, by their numbers; None changes nothing."""
        if intentions is None:
            return self
        asked = replace(self, asked=tuple(sorted(intentions)))
        vars(asked).update(_rises=self._rises, _rose_from=self._rose_from)
        return asked

    def rises(self, intention: int, rise: float | None) -> Rises:
        """Return where the levels of an intention rise. rise: see `AlarmSettings`."""
        key = intention, rise
        if key not in self._rises:
            rose_from = None if rise is None else self.rose_from(rise)[:, intention]
            self._rises[key] = Rises.of(self.level[:, intention], self.begins, rose_from)
        return self._rises[key]

    def rose_from(self, rise: float) -> Float32Array:
        """Return the trough from which each level has just risen anew, NEVER where it has not, (n, 6).

        rise: as in `Swing`. Runs between pauses are followed side by side.
        """
        if rise not in self._rose_from:
            self._rose_from[rise] = self._followed(rise)
        return self._rose_from[rise]

    def _followed(self, rise: float) -> Float32Array:
        rose_from = np.full(self.level.shape, NEVER, np.float32)
        starts = np.flatnonzero(self.begins)
        lengths = np.diff(starts, append=len(self.level))
        order = np.argsort(-lengths, kind="stable")
        starts, lengths = starts[order], lengths[order]
        swing = Swing.at(self.level[starts], rise)
        for step in range(1, int(lengths[0]) if len(lengths) else 0):
            going = int(np.searchsorted(-lengths, -step, side="left"))
            rows = starts[:going] + step
            swing = Swing(rise, swing.peak[:going], swing.trough[:going], swing.fallen[:going])
            rose_from[rows] = swing.step(self.level[rows])
        return rose_from


@dataclass(frozen=True)
class Alarms:
    """The n alarms of one episode, sorted by intention, then vehicle, then time.

    intention: its number in KNOWN, (n,). row: number of the prediction that raised the alarm, (n,). vehicle, time_s:
    vehicle and time of that prediction, (n,).
    """

    intention: IntArray
    row: IntArray
    vehicle: IntArray
    time_s: Array

    def __len__(self) -> int:
        return len(self.row)


def pauses(episode: LiveEpisode) -> BoolArray:
    """Return whether each prediction is the first of its vehicle, or the first after a pause, (n,)."""
    count = len(episode.time_s)
    begins = np.ones(count, dtype=bool)
    if count:
        begins[1:] = (np.diff(episode.vehicle) != 0) | is_pause(np.diff(episode.time_s), episode.facts.decision_s)
    return begins


def reject_levels(answers: Answers, least_probability: float) -> Float32Array:
    """Return the levels of the paper's method, (n, 6).

    The level of the likeliest intention is the unknown score; all others are NEVER.
    least_probability: if the likeliest intention is less likely than this, its level is NEVER, too.
    """
    level = np.full(answers.probabilities.shape, NEVER, np.float32)
    if len(level):
        rows, likeliest = np.arange(len(level)), answers.probabilities.argmax(axis=1)
        sure = answers.probabilities[rows, likeliest] >= least_probability
        level[rows[sure], likeliest[sure]] = answers.score[sure]
    return level


def hazard_levels(answers: Answers) -> Float32Array:
    """Return the levels of a run that was trained on streams, the log-odds of each intention, (n, 6)."""
    odds = np.full(answers.probabilities.shape, NEVER, np.float32)
    some = answers.probabilities > LEAST_PROBABILITY
    probability = np.minimum(answers.probabilities[some].astype(np.float64), 1 - LEAST_PROBABILITY)
    odds[some] = np.log(probability / (1 - probability))
    return odds


def confirmed(levels: Levels, k: int, n: int) -> Levels:
    """Return the confirmed levels: of the last n at every prediction. Those from before a pause are NEVER."""
    if n == 1:
        return levels
    run = np.cumsum(levels.begins)
    recent = np.full((n, *levels.level.shape), NEVER, np.float32)
    recent[0] = levels.level
    for back in range(1, min(n, len(run))):
        same = run[back:] == run[:-back]
        recent[back, back:][same] = levels.level[:-back][same]
    return Levels(confirm(recent, k), levels.vehicle, levels.time_s, levels.begins, levels.asked)


def raised(levels: Levels, thresholds: Array | float, refractory_s: float, rise: float | None = None) -> Alarms:
    """Return the alarms that confirmed levels raise.

    thresholds: of each intention, (6,), or a single one for all. refractory_s, rise: see `AlarmSettings`.
    """
    limits = np.broadcast_to(np.asarray(thresholds, np.float64), levels.level.shape[1:]).tolist()
    of_intentions = [levels.rises(k, rise).at(limits[k]) for k in levels.asked]
    rows = np.concatenate([np.empty(0, np.int64), *of_intentions])
    intentions = np.repeat(np.array(levels.asked, np.int64), [len(part) for part in of_intentions])
    vehicle, time_s = levels.vehicle[rows], levels.time_s[rows]
    soon = np.zeros(len(rows), dtype=bool)
    soon[1:] = (np.diff(intentions) == 0) & (np.diff(vehicle) == 0) & is_too_soon(np.diff(time_s), refractory_s)
    kept, last = ~soon, NEVER
    places = np.flatnonzero(soon)
    for place, at, before in zip(places.tolist(), time_s[places].tolist(), time_s[places - 1].tolist(), strict=True):
        # Where the alarm before is dropped, too, the last one kept is still the one that both follow too soon.
        if kept[place - 1]:
            last = before
        kept[place] = not is_too_soon(at - last, refractory_s)
    return Alarms(intentions[kept], rows[kept], vehicle[kept], time_s[kept])


def alarms(levels: Levels, settings: AlarmSettings) -> Alarms:
    """Return the alarms that levels raise with some settings. levels: by the settings' method, not confirmed yet."""
    return raised(confirmed(levels, settings.k, settings.n), settings.thresholds, settings.refractory_s, settings.rise)


def duty_cycle(levels: Levels, settings: AlarmSettings) -> float | None:
    """Return the share of predictions at which some intention reaches its threshold; None without any prediction."""
    asked = list(levels.asked)
    level = confirmed(levels, settings.k, settings.n).level[:, asked]
    return float((level >= settings.thresholds[asked]).any(axis=1).mean()) if len(level) else None


def peaks(levels: Levels, intentions: Sequence[int] | None = None) -> Float32Array:
    """Return the highest confirmed level of each intention between two pauses, where there is one, (m,).

    intentions: numbers of those that matter; all by default.
    """
    if not len(levels.level):
        return np.empty(0, np.float32)
    level = levels.level[:, [k for k in levels.asked if intentions is None or k in intentions]]
    highest = np.maximum.reduceat(level, np.flatnonzero(levels.begins), axis=0)
    return np.asarray(highest[np.isfinite(highest)], np.float32)
