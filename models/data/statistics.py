"""Plain statistics of a window: what the boosted trees see of it, and a network may."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.models.data.windows import Windows

STATISTICS = (
    "mean",
    "sd",
    "min",
    "max",
    "first",
    "last",
    "slope",
    "mean_first_third",
    "mean_middle_third",
    "mean_last_third",
)
"""Statistics of each of a window's twelve state components; the slope is the least-squares one, per sample."""
N_STATISTICS = 12 * len(STATISTICS)
"""Number of all statistics of a window."""


MEANS_S = (0.1, 0.2, 0.4)
"""Spans at the end of a window over which the TV's motion is averaged, s."""
SLOPES_S = (0.2, 0.4)
"""Spans at the end of a window over which the least-squares slope of the TV's motion is taken, s."""
N_RECENT = 4 * (len(MEANS_S) + len(SLOPES_S))
"""Number of columns of `recent_motion`."""


def recent_motion(windows: Windows, tv_rate_hz: float) -> Float32Array:
    """Return how the TV has moved most lately, (n, 20).

    Statistics of whole windows smear what has just begun over 2.2 s. These are, for vx, vy, ax and ay in turn, the
    means over the last MEANS_S, then the slopes over the last SLOPES_S, per second. A span is at least as long as a
    sample, or two samples for a slope, and at most as long as the window.
    """
    motion = windows.tv[:, 2:6].astype(np.float64)
    longest = motion.shape[2]

    def last(span_s: float, least: int) -> Array:
        return np.asarray(motion[:, :, longest - min(max(least, round(span_s * tv_rate_hz)), longest) :])

    columns = [last(span_s, 1).mean(axis=2) for span_s in MEANS_S]
    for span_s in SLOPES_S:
        part = last(span_s, 2)
        t = (np.arange(part.shape[2]) - (part.shape[2] - 1) / 2) / tv_rate_hz
        columns.append(part @ t / (t @ t) if t.any() else np.zeros(part.shape[:2]))
    return np.stack(columns, axis=2).reshape(len(motion), -1).astype(np.float32)


def statistics(windows: Windows) -> Float32Array:
    """Return STATISTICS of every component of the TV's, then of the UV's stream, (n, 120)."""
    return np.concatenate([_of_stream(windows.tv), _of_stream(windows.uv)], axis=1).astype(np.float32)


def _of_stream(states: Float32Array) -> Array:
    """Return the statistics of a stream (n, 6, T), component by component, (n, 60)."""
    x = states.astype(np.float64)
    t = np.arange(x.shape[2]) - (x.shape[2] - 1) / 2
    thirds = [part.mean(axis=2) for part in np.array_split(x, 3, axis=2)]
    slope = x @ t / (t @ t)
    parts = [x.mean(axis=2), x.std(axis=2), x.min(axis=2), x.max(axis=2), x[..., 0], x[..., -1], slope, *thirds]
    return np.stack(parts, axis=2).reshape(len(x), -1)
