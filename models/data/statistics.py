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
