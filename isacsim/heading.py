"""The direction in which a vehicle points, from how it moves."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array

MOVING_MPS = 0.5
"""Slowest speed whose direction counts: below it, noise of a reported velocity turns the direction by degrees."""


def heading_rad(velocity: Array) -> Array:
    """Heading of one vehicle at each instant, counter-clockwise from +x.

    A vehicle that stands keeps the direction in which it last moved; before it first moves, it has the direction in
    which it will move. The heading is that of the motion: the few degrees by which a car's body turns against its
    path are neglected.

    velocity: vx, vy, m/s, (2, S). Returns radians, (S,), NaN throughout if the vehicle never moves.
    """
    moving = np.hypot(velocity[0], velocity[1]) >= MOVING_MPS
    if not moving.any():
        return np.full(velocity.shape[1], np.nan)
    latest = np.maximum.accumulate(np.where(moving, np.arange(len(moving)), -1))
    source = np.where(latest < 0, int(np.argmax(moving)), latest)
    return np.asarray(np.arctan2(velocity[1, source], velocity[0, source]))
