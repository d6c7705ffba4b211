"""The point of the plane to which the positions of a record are relative.

States are stored as float32, whose steps are 2 mm at a distance of 20 km from the origin: as large as the errors of
sensing, and 0.3 m/s where positions at 400 Hz are differentiated. Each record therefore has a point of its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, Float32Array

GRID_M = 100.0
"""Points have coordinates that are multiples of this, m: near enough to be precise, and they say little of the TV."""


def point_near(x: float, y: float) -> tuple[float, float]:
    """Return the point for a record whose TV is at x, y in the scenario's plane when it starts, m."""
    return round(x / GRID_M) * GRID_M, round(y / GRID_M) * GRID_M


def relative(states: Array, point: tuple[float, float]) -> Float32Array:
    """Return states in the scenario's plane, (6, n) or the first rows of them, as they are stored: float32."""
    stored = np.array(states, np.float64)
    stored[:2] -= np.reshape(point, (2, 1))
    return np.asarray(stored, np.float32)


def in_plane(
    states: npt.NDArray[np.floating], x0: float | npt.NDArray[np.floating], y0: float | npt.NDArray[np.floating]
) -> Array:
    """Return stored states, (6, n) or (N, 6, n), in the scenario's plane, float64.

    x0, y0: the point of the record, or those of the N records, (N,), m.
    """
    placed = np.array(states, np.float64)
    placed[..., 0, :] += np.asarray(x0)[..., None]
    placed[..., 1, :] += np.asarray(y0)[..., None]
    return placed
