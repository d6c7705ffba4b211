"""A vehicle rolls along its lane: what the road's map says of how fast it moves across.

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
