"""What the detectors share: when a sampled signal passes a level, to a fraction of a sample.

Signals are linear between samples, so that an event is found at the same instant at any sampling rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isacsim.arrays import Array


def _passing(times: Array, values: Array, level: float, k: int) -> float:
    """The instant between samples k and k + 1 at which the values pass the level."""
    rise = values[k + 1] - values[k]
    share = 0.0 if rise == 0 else (level - values[k]) / rise
    return float(times[k] + share * (times[k + 1] - times[k]))


def spells(times: Array, values: Array, level: float) -> list[tuple[float, float]]:
    """The maximal intervals in which the values are at or above the level, s, in order.

    times: s, shape (n,), ascending. values: shape (n,). An interval cut by an end of the signal ends there.
    """
    above = values >= level
    flips = np.flatnonzero(above[1:] != above[:-1])
    edges = [_passing(times, values, level, int(k)) for k in flips]
    if len(above) and above[0]:
        edges.insert(0, float(times[0]))
    if len(above) and above[-1]:
        edges.append(float(times[-1]))
    return list(zip(edges[0::2], edges[1::2], strict=True))


def last_below(times: Array, values: Array, level: float, before: float) -> float | None:
    """The last instant up to `before` at which the values are under the level, s; None if there is none."""
    stop = int(np.searchsorted(times, before, side="right"))
    below = np.flatnonzero(values[:stop] < level)
    if not len(below):
        return None
    k = int(below[-1])
    return float(times[k]) if k + 1 >= len(times) else min(before, _passing_up(times, values, level, k))


def first_below(times: Array, values: Array, level: float, after: float) -> float | None:
    """The first instant from `after` on at which the values are under the level, s; None if there is none."""
    start = int(np.searchsorted(times, after, side="left"))
    below = np.flatnonzero(values[start:] < level)
    if not len(below):
        return None
    k = start + int(below[0])
    if k == 0 or values[k - 1] < level:
        return float(times[k])
    return max(after, _passing(times, values, level, k - 1))


def _passing_up(times: Array, values: Array, level: float, k: int) -> float:
    """The instant after sample k at which the values rise to the level; sample k's own if they do not."""
    return _passing(times, values, level, k) if values[k + 1] >= level else float(times[k])


@dataclass(frozen=True)
class Surge:
    """One excursion of a signal: from first motion over the threshold to rest, s, and its greatest value."""

    onset: float
    commit: float
    end: float
    peak: float


def surges(times: Array, values: Array, level: float, hold_s: float, rest: float, trace_back_s: float) -> list[Surge]:
    """Excursions in which the values stay at or above `level` for at least `hold_s`.

    commit: the start of the first such stay. onset: the last instant before it under `rest`, at most `trace_back_s`
    earlier. end: the first instant after it under `rest`, or the signal's end; stays before that end belong to the same
    excursion.
    """
    found: list[Surge] = []
    for start, stop in spells(times, values, level):
        if stop - start < hold_s or (found and start < found[-1].end):
            continue
        earliest = max(float(times[0]), start - trace_back_s)
        onset = max(earliest, last_below(times, values, rest, start) or earliest)
        end = first_below(times, values, rest, stop)
        end = float(times[-1]) if end is None else end
        inside = (times >= start) & (times <= stop) if end <= stop else (times >= start) & (times <= end)
        found.append(Surge(onset, start, end, float(values[inside].max(initial=level))))
    return found
