"""Alarms as they come: the rule of `evaluation.in_traffic.alarms.alarms`, applied answer by answer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, Float32Array
from isac_cosim.evaluation.in_traffic.alarms.alarms import (
    Swing,
    confirm,
    hazard_levels,
    is_pause,
    is_too_soon,
    reject_levels,
)
from isac_cosim.evaluation.in_traffic.alarms.background import BackgroundTrees
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN

Levelling = Callable[[Answers], Float32Array]
"""Gives answers their levels, (n, 6)."""


@dataclass(frozen=True)
class Alarm:
    """An intention of a TV that the network believes in. time_s: of the world's clock. intention: its text."""

    tv: str
    intention: str
    time_s: float


def levelling(settings: AlarmSettings, background: BackgroundTrees | None) -> Levelling:
    """Return how answers get their levels for alarms of some settings. background: for the method of that name."""
    if settings.method == "reject":
        return lambda answers: reject_levels(answers, settings.least_probability)
    if settings.method == "hazard":
        return hazard_levels
    assert background is not None, "the method `background` needs its trees"
    return background.levels_of


@dataclass
class _History:
    """The latest levels of a vehicle, and when the last came, s.

    on: whether each intention reaches its threshold. last_s: when it had its last alarm, s. swing: how its confirmed
    levels fall and rise; None before the first one, and where no new rise raises an alarm.
    """

    recent: deque[Float32Array]
    time_s: float = -np.inf
    on: BoolArray = field(default_factory=lambda: np.zeros(len(KNOWN), dtype=bool))
    last_s: Array = field(default_factory=lambda: np.full(len(KNOWN), -np.inf))
    swing: Swing | None = None


@dataclass
class AlarmStream:
    """Raises alarms from one decision to the next. decision_s: time between them; a longer pause begins anew."""

    settings: AlarmSettings
    levels: Levelling
    decision_s: float
    _of: dict[str, _History] = field(default_factory=dict)

    def raised(self, tvs: Sequence[str], answers: Answers, time_s: float) -> list[Alarm]:
        """Return the alarms about the TVs that were answered at a time, s."""
        alarms = []
        for name, level in zip(tvs, self.levels(answers), strict=True):
            alarms += [Alarm(name, KNOWN[k].text, time_s) for k in self._rising(name, level, time_s)]
        return alarms

    def _rising(self, name: str, level: Float32Array, time_s: float) -> list[int]:
        settings, history = self.settings, self._of.get(name)
        if history is None:
            history = self._of[name] = _History(deque(maxlen=settings.n))
        elif is_pause(time_s - history.time_s, self.decision_s):
            history.recent.clear()
            history.on = np.zeros_like(history.on)
            history.swing = None
        history.recent.append(level)
        history.time_s = time_s
        confirmed = confirm(np.stack(history.recent), settings.k)
        on = confirmed >= settings.thresholds
        rising = on & ~history.on
        if history.swing is not None:
            rising |= history.swing.step(confirmed) >= settings.thresholds
        elif settings.rise is not None:
            history.swing = Swing.at(confirmed, settings.rise)
        since_s = time_s - history.last_s
        alarms = rising & ~is_too_soon(since_s, settings.refractory_s)
        history.last_s[alarms] = time_s
        history.on = on
        return np.flatnonzero(alarms).tolist()
