"""Alarms as they come: what `evaluation.in_traffic.alarms.alarms` finds in a whole episode, answer by answer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Float32Array
from isac_cosim.evaluation.in_traffic.alarms.alarms import NEVER, reject_levels
from isac_cosim.evaluation.in_traffic.alarms.background import Background
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


def levelling(settings: AlarmSettings, background: Background | None) -> Levelling:
    """Return how answers get their levels for alarms of some settings. background: for the method of that name."""
    if settings.method == "reject":
        return lambda answers: reject_levels(answers, settings.least_probability)
    assert background is not None, "the method `background` needs its trees"
    return background.levels_of


@dataclass
class _History:
    """The latest levels of a vehicle. last: when each intention had its last alarm, s. on: the latest confirmed."""

    recent: deque[Float32Array]
    time_s: float
    on: Float32Array
    last: dict[int, float] = field(default_factory=dict)


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
        never = np.full(level.shape, NEVER, np.float32)
        if history is None:
            history = self._of[name] = _History(deque(maxlen=settings.n), time_s, never)
        elif time_s - history.time_s > 1.5 * self.decision_s:
            history.recent.clear()
            history.on = never
        history.recent.append(level)
        history.time_s = time_s
        confirmed = never
        if len(history.recent) >= settings.k:
            confirmed = np.sort(np.stack(history.recent), axis=0)[-settings.k]
        rising = (confirmed >= settings.thresholds) & ~(history.on >= settings.thresholds)
        history.on = confirmed
        alarms = []
        for k in np.flatnonzero(rising).tolist():
            if time_s - history.last.get(k, -np.inf) >= settings.refractory_s - 1e-9:
                history.last[k] = time_s
                alarms.append(k)
        return alarms
