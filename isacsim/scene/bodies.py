"""Where a vehicle echoes: one point at its front bumper, or five points of its body, and how strongly each does.

The five are those of 3GPP TR 38.901, Table 7.9.2.1-5: the middle of the front, the back, the left and the right side at
half the vehicle's height, and of the roof. The body moves without turning during a snapshot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.cross_section import points_dbsm

BEHIND = np.array([0.0, 1.0, 0.5, 0.5, 0.5])
"""How far behind the front bumper the five points are: front, back, left, right, roof, lengths of the vehicle."""
ASIDE = np.array([0.0, 0.0, 0.5, -0.5, 0.0])
"""How far to the left of its axis, widths."""
UP = np.array([0.5, 0.5, 0.5, 0.5, 1.0])
"""How high, heights."""


@dataclass(frozen=True)
class SeenPoints:
    """N vehicles' J points as I panels see them.

    measured: sine, slant range (m), radial velocity (m/s), (N, I, J, 3). azimuth, zenith: of the direction from each
    point to the panel, from the vehicle's heading and from the vertical, radians, (N, I, J).
    """

    measured: Array
    azimuth: Array
    zenith: Array

    def strength_dbsm(self) -> Array:
        """Return the mean cross-section of each of five points, dBsm, (N, I, 5)."""
        return points_dbsm(self.azimuth, self.zenith)


def look(state: Array, ahead: Array, size: Array | None, panels: Panels) -> SeenPoints:
    """Return what panels see of vehicles' points.

    state: x, y (m), vx, vy (m/s) of the front bumper's centre, (N, 4). ahead: unit vector of the heading, (N, 2). size:
    length, width and height, m, (N, 3); None for one point at the front bumper, at the panels' own target height.
    """
    count, of_points = len(state), 1 if size is None else len(BEHIND)
    place = np.repeat(state[:, None, :2], of_points, axis=1)
    up = np.full((count, of_points), panels.target_height_m)
    if size is not None:
        left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        place -= (size[:, :1] * BEHIND)[..., None] * ahead[:, None]
        place += (size[:, 1:2] * ASIDE)[..., None] * left[:, None]
        up = size[:, 2:] * UP
    dx = place[:, None, :, 0] - panels.x[:, None]
    dy = place[:, None, :, 1] - panels.y[:, None]
    above = panels.height_m[:, None] + panels.target_height_m - up[:, None]
    distance = np.sqrt(dx**2 + dy**2 + above**2)
    sine = (panels.right[:, 0, None] * dx + panels.right[:, 1, None] * dy) / distance
    radial = (dx * state[:, 2, None, None] + dy * state[:, 3, None, None]) / distance
    along = ahead[:, 0, None, None] * dx + ahead[:, 1, None, None] * dy
    across = ahead[:, 0, None, None] * dy - ahead[:, 1, None, None] * dx
    return SeenPoints(
        np.stack([sine, distance, radial], axis=-1), np.arctan2(-across, -along), np.arccos(above / distance)
    )
