"""Radar cross-section of a vehicle, by the angle at which the panel sees it, and its random part.

Source: 3GPP TR 38.901 (Release 19), clause 7.9.2.1, RCS model 2 for monostatic sensing, with the parameters of Table
7.9.2.1-4, a vehicle as a single scattering point:

    10 lg(sigma_M sigma_D) = G_max - min(H + V, sigma_max)
    H = min(12 ((phi - phi_c) / phi_3dB)^2, sigma_max),  V = min(12 ((theta - theta_c) / theta_3dB)^2, sigma_max)

with phi the azimuth from the vehicle's front and theta the zenith angle,
both of the direction from the vehicle to the panel. Each of the four sides has its own lobe within 45 degrees of its
centre, and the roof has one at zenith angles below 30 degrees. Between the lobes all sides fall to the same 7.1 dBsm,
so the pattern is continuous but for steps of 0.01 dB. The table's values were read from NIST's implementation of the
clause (`getSigmaRCS.m` of its NR radar simulator).
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array

SIDES = ("front", "left", "back", "right")
"""Rows of the arrays below: side k is centred at an azimuth of 90 k degrees, counter-clockwise from the front."""
AZIMUTH_WIDTH_DEG = np.array([40.54, 26.90, 36.32, 26.90])
ZENITH_CENTRE_DEG = np.array([71.75, 79.70, 79.65, 79.70])
ZENITH_WIDTH_DEG = np.array([29.13, 44.42, 36.73, 44.42])
PEAK_DBSM = np.array([15.52, 20.75, 14.56, 20.75])
DEPTH_DB = np.array([8.45, 13.68, 7.50, 13.68])
ROOF_BELOW_DEG, ROOF_WIDTH_DEG, ROOF_PEAK_DBSM, ROOF_DEPTH_DB = 30.0, 18.13, 21.26, 14.19


def aspect_dbsm(azimuth_rad: Array, zenith_rad: Array) -> Array:
    """Mean cross-section of a vehicle seen from a direction, dBsm.

    azimuth_rad: of the direction to the panel, from the vehicle's heading, (...). zenith_rad: the angle between that
    direction and the vertical, (...). Returns (...).

    From the front, from 50 degrees aside, and from the left, by a panel as high as the vehicle:

    >>> aspect_dbsm(np.radians([0.0, 50.0, 90.0]), np.radians(90.0)).round(1).tolist()
    [10.8, 7.1, 20.1]
    """
    azimuth, zenith = np.broadcast_arrays(np.degrees(azimuth_rad), np.degrees(zenith_rad))
    turns = np.round(azimuth / 90)
    side = turns.astype(np.int64) % len(SIDES)
    depth = DEPTH_DB[side]
    across = np.minimum(12 * ((azimuth - 90 * turns) / AZIMUTH_WIDTH_DEG[side]) ** 2, depth)
    upward = np.minimum(12 * ((zenith - ZENITH_CENTRE_DEG[side]) / ZENITH_WIDTH_DEG[side]) ** 2, depth)
    sides = PEAK_DBSM[side] - np.minimum(across + upward, depth)
    roof = ROOF_PEAK_DBSM - np.minimum(12 * (zenith / ROOF_WIDTH_DEG) ** 2, ROOF_DEPTH_DB)
    return np.asarray(np.where(zenith < ROOF_BELOW_DEG, roof, sides))


def random_mean_db(deviation_db: float) -> float:
    """Mean, in dB, of the random part of a cross-section: the log-normal whose linear mean is one.

    deviation_db: standard deviation of the random part, dB. Source: 3GPP TR 38.901, clause 7.9.2.1.

    >>> round(random_mean_db(3.41), 2)
    -1.34
    """
    return float(-np.log(10) / 20 * deviation_db**2)


POINT_AZIMUTH_DEG = np.array([0.0, 180.0, 90.0, 270.0])
POINT_WIDTH_DEG = np.array([40.54, 36.32, 26.90, 26.90])
POINT_ZENITH_DEG = np.array([71.75, 79.65, 79.70, 79.70, 0.0])
POINT_ZENITH_WIDTH_DEG = np.array([29.13, 36.73, 44.42, 44.42, 18.13])
POINT_PEAK_DBSM = np.array([14.99, 13.90, 20.60, 20.60, 21.12])
POINT_DEPTH_DB = np.array([14.91, 13.82, 20.52, 20.52, 21.05])
"""Table 7.9.2.1-5, a vehicle as five scattering points: front, back, left, right, roof. The roof's lobe is the same all
around."""


def points_dbsm(azimuth_rad: Array, zenith_rad: Array) -> Array:
    """Mean cross-section of each of a vehicle's five scattering points, dBsm, (..., 5).

    azimuth_rad, zenith_rad: of the direction from each point to the panel, as in `aspect_dbsm`, (..., 5). The pattern
    is that of `aspect_dbsm` with one set of parameters a point, at all angles.

    >>> points_dbsm(np.zeros(5), np.full(5, np.pi / 2)).round(2).tolist()
    [10.28, 0.08, 0.08, 0.08, 0.07]
    """
    azimuth, zenith = np.degrees(azimuth_rad), np.degrees(zenith_rad)
    across = np.zeros(np.broadcast_shapes(azimuth.shape, zenith.shape))
    turned = (azimuth[..., :4] - POINT_AZIMUTH_DEG + 180) % 360 - 180
    across[..., :4] = np.minimum(12 * (turned / POINT_WIDTH_DEG) ** 2, POINT_DEPTH_DB[:4])
    upward = np.minimum(12 * ((zenith - POINT_ZENITH_DEG) / POINT_ZENITH_WIDTH_DEG) ** 2, POINT_DEPTH_DB)
    return np.asarray(POINT_PEAK_DBSM - np.minimum(across + upward, POINT_DEPTH_DB))
