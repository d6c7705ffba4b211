"""A vehicle rolls: its acceleration across changes more slowly than that along, and it moves across its lane slowly.

Panels that look along a road measure the velocity along it and hardly that across. Where a neighbour shares its cells,
a body's track would drift sideways. Wheels do not: a vehicle moves across its lane at a small share of its speed, and
one that stands does not move at all.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scene.extent import LASTS

ACROSS_SHARE, ACROSS_MPS = 0.05, 0.1
"""Standard deviation of the velocity across a lane: a share of the speed, 3 degrees of heading, and m/s. It is that of
`LASTS` instants, because a lane change lasts."""
ACROSS_JERK = 0.1
"""Spectral density of the jerk across a vehicle's heading, as a share of that along it: brakes bite within a few tenths
of a second, and a lane change takes one or two to reach its largest acceleration."""


def rolling_noise(noise: Array, ahead: Array) -> Array:
    """Return the process noise of tracks, less across their heading than along it, (T, 7, 7).

    noise: with the same jerk along either axis, of x, y, vx, vy, ax, ay and the length, (7, 7). ahead: unit vectors of
    the heading, (T, 2).
    """
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    share = np.eye(2) - (1 - ACROSS_JERK) * across[:, :, None] * across[:, None]
    result = np.tile(noise, (len(ahead), 1, 1))
    for k in (0, 2, 4):
        for n in (0, 2, 4):
            result[:, k : k + 2, n : n + 2] = noise[k, n] * share
    return result


def rolled(state: Array, covariance: Array, along: Array) -> tuple[Array, Array]:
    """Return tracks that have been told that they move along their lanes, with their covariances.

    state: x, y, vx, vy first, m, m/s, (T, 7). covariance: (T, 7, 7). along: unit vector of each one's lane, NaN for
    none, (T, 2).
    """
    across = np.nan_to_num(np.stack([-along[:, 1], along[:, 0]], axis=1))
    speed = np.hypot(state[:, 2], state[:, 3])
    variance = LASTS * (ACROSS_MPS + ACROSS_SHARE * speed) ** 2
    shared = (covariance[:, :, 2:4] @ across[..., None])[..., 0]
    gain = shared / ((shared[:, 2:4] * across).sum(axis=1) + variance)[:, None]
    drift = (state[:, 2:4] * across).sum(axis=1)
    return state - gain * drift[:, None], covariance - gain[:, :, None] * shared[:, None]
