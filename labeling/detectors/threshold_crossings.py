"""When a sampled signal crosses a level, to a fraction of a sample: shared by the detectors.

Signals are taken as linear between samples, so that an event gets the same times at any sampling rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array


def intervals_above(times: Array, values: Array, level: float) -> list[tuple[float, float]]:
    """Return the maximal intervals in which a signal is at or above a level: (start, stop) in s, in order.

    times: s, shape (n,), ascending. values: shape (n,). An interval that the end of the signal cuts off ends there.

    >>> intervals_above(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 4.0, 4.0, 0.0]), 2.0)
    [(0.5, 2.5)]
    """
    above = values >= level
    flips = np.flatnonzero(above[1:] != above[:-1])
    edges = [_crossing_time(times, values, level, int(k)) for k in flips]
    if len(above) and above[0]:
        edges.insert(0, float(times[0]))
    if len(above) and above[-1]:
        edges.append(float(times[-1]))
    return list(zip(edges[0::2], edges[1::2], strict=True))


def last_below(times: Array, values: Array, level: float, before: float) -> float | None:
    """Return the last time up to `before` at which a signal is below a level, s, or None if there is none."""
    stop = int(np.searchsorted(times, before, side="right"))
    below = np.flatnonzero(values[:stop] < level)
    if not len(below):
        return None
    k = int(below[-1])
    if k + 1 == len(times) or values[k + 1] < level:
        return float(times[k])
    return min(before, _crossing_time(times, values, level, k))


def first_below(times: Array, values: Array, level: float, after: float) -> float | None:
    """Return the first time from `after` on at which a signal is below a level, s, or None if there is none."""
    start = int(np.searchsorted(times, after, side="left"))
    below = np.flatnonzero(values[start:] < level)
    if not len(below):
        return None
    k = start + int(below[0])
    if k == 0 or values[k - 1] < level:
        return float(times[k])
    return max(after, _crossing_time(times, values, level, k - 1))


def _crossing_time(times: Array, values: Array, level: float, k: int) -> float:
    """Return the time between samples k and k + 1 at which the signal crosses the level, s."""
    rise = values[k + 1] - values[k]
    share = 0.0 if rise == 0 else (level - values[k]) / rise
    return float(times[k] + share * (times[k + 1] - times[k]))


@dataclass(frozen=True)
class Excursion:
    """One excursion of a signal: first rise above rest, threshold reached, back at rest (all s), and its maximum."""

    onset: float
    commit: float
    end: float
    peak: float


def excursions(
    times: Array, values: Array, level: float, hold_s: float, rest: float, trace_back_s: float
) -> list[Excursion]:
    """Return the excursions in which a signal stays at or above `level` for at least `hold_s`, in order.

    times: s, shape (n,), ascending. values: shape (n,), in the unit of `level` and `rest`.
    commit: the start of the first such interval. onset: the last time before it below `rest`, at most `trace_back_s`
    earlier. end: the first time after it below `rest`, or the end of the signal; further intervals before that belong
    to the same excursion.
    """
    result: list[Excursion] = []
    for start, stop in intervals_above(times, values, level):
        if stop - start < hold_s or (result and start < result[-1].end):
            continue
        earliest = max(float(times[0]), start - trace_back_s)
        onset = max(earliest, last_below(times, values, rest, start) or earliest)
        end = first_below(times, values, rest, stop)
        end = float(times[-1]) if end is None else end
        inside = (times >= start) & (times <= max(stop, end))
        result.append(Excursion(onset, start, end, float(values[inside].max(initial=level))))
    return result
