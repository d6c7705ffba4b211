"""Where the sites' panels are, and what each of them measures of a vehicle.

A panel measures the sine of the angle between the line of sight and its broadside, the slant range, and the radial
velocity. (A linear array on a mast measures the cone about its axis, not the bearing.) With the target's height known,
all three are functions of its position and velocity on the ground:

    d = p - p_site,  R = sqrt(|d|^2 + h^2),  sine = e.d / R,  v_r = d.v / R

where h is the difference in height and e the horizontal unit vector along the array, to the right of its azimuth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.scenarios.scenario import Site


@dataclass(frozen=True)
class Panels:
    """Geometry of panels: of I sites, arrays (I,), or of I echoes at each of S instants, arrays (S, I).

    x, y: m. height_m: of the panel above the target's reflecting point, which is target_height_m above the road.
    right: unit vector along the array, (..., 2). front: unit vector in which the panel faces, (..., 2).
    """

    x: Array
    y: Array
    height_m: Array
    right: Array
    front: Array
    target_height_m: float

    @staticmethod
    def of(sites: Sequence[Site], target_height_m: float) -> Panels:
        """Make the panels of sites, arrays (I,). target_height_m: of the reflecting point above the road."""
        azimuth = np.radians([site.azimuth_deg for site in sites])
        return Panels(
            np.array([site.x for site in sites], dtype=np.float64),
            np.array([site.y for site in sites], dtype=np.float64),
            np.array([site.height_m for site in sites], dtype=np.float64) - target_height_m,
            np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=-1),
            np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1),
            target_height_m,
        )

    def take(self, index: IntArray) -> Panels:
        """Take the panels of echoes. index: numbers of their sites, (S, I)."""
        x, y, height = self.x[index], self.y[index], self.height_m[index]
        return Panels(x, y, height, self.right[index], self.front[index], self.target_height_m)

    def reordered(self, order: IntArray) -> Panels:
        """Reorder the panels (S, I) of each instant. order: positions along the last axis, (S, I)."""
        x, y, height = (np.take_along_axis(a, order, axis=1) for a in (self.x, self.y, self.height_m))
        right, front = (np.take_along_axis(a, order[..., None], axis=1) for a in (self.right, self.front))
        return Panels(x, y, height, right, front, self.target_height_m)

    def measured(self, state: Array) -> Array:
        """What the panels measure of a vehicle: sine, slant range (m), radial velocity (m/s), (S, I, 3).

        state: x, y (m), vx, vy (m/s), (S, 4).
        """
        dx, dy, distance = self.sight(state[:, 0, None], state[:, 1, None])
        sine = (self.right[..., 0] * dx + self.right[..., 1] * dy) / distance
        radial = (dx * state[:, 2, None] + dy * state[:, 3, None]) / distance
        # Each quantity in one piece of memory: loops along the instants are faster than loops over three numbers.
        return np.moveaxis(np.stack([sine, distance, radial]), 0, -1)

    def sight(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Horizontal offsets dx, dy from panel to vehicle and the slant range, m. x, y: of the vehicle, m."""
        dx, dy = x - self.x, y - self.y
        return dx, dy, np.sqrt(dx**2 + dy**2 + self.height_m**2)
