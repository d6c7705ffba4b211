"""The paper's fusion: TDoA and AoA as linear equations in position and first range (Eq. 5), then the Dopplers.

With the bearings theta_i, the ground ranges r_i and r_i1 = r_i - r_1, each site gives a row in (x, y, r_1):

    -2 x_i1 x - 2 y_i1 y - 2 r_i1 r_1 = r_i1^2 - k_i + k_1        (i > 1)
    sin(theta_i) x - cos(theta_i) y   = sin(theta_i) x_i - cos(theta_i) y_i

The leading minus of Eq. (5) covers the whole matrix. The paper weighs range and angle rows of a site alike, although
the range rows have coefficients of hundreds; the weights `covariance` follow what noise does to each row.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.tracking.fusion import Fixes, FusionOptions, single_site, sound_fixes


def fuse_eq5(measured: Array, deviation: Array, used: BoolArray, panels: Panels, settings: FusionOptions) -> Fixes:
    """Fuse the measurements of each instant by Eq. (5); arguments and result as in `fusion.FusionMethod`.

    It needs two sites. The covariance is that of the estimate with the weights that it used.
    """
    # The first range is the reference of all others, so it has to be one that was measured.
    order = np.argsort(~used, axis=1, kind="stable")
    measured, deviation = (np.take_along_axis(a, order[..., None], axis=1) for a in (measured, deviation))
    used = np.take_along_axis(used, order, axis=1)
    panels = panels.reordered(order)
    position, spread = _position(measured, deviation, used, panels, settings)
    velocity, covariance = _velocity(position, spread, measured, deviation, used, panels, settings)
    return sound_fixes(np.concatenate([position, velocity], axis=1), covariance, np.asarray(used.sum(axis=1) >= 2))


def _position(
    measured: Array, deviation: Array, used: BoolArray, panels: Panels, settings: FusionOptions
) -> tuple[Array, Array]:
    """Position (S, 2) and its covariance (S, 2, 2)."""
    matrix, right = _equations(measured, panels)
    row_used = np.concatenate([used[:, 1:], used], axis=1)
    noise = _row_covariance(measured, deviation, panels)
    both = row_used[:, :, None] & row_used[:, None, :]
    noise = np.where(both, noise, 0.0)
    if settings.eq5_weights == "covariance":
        weight = np.where(both, np.linalg.inv(noise + (~row_used)[:, :, None] * np.eye(noise.shape[1])), 0.0)
    else:
        site_weight = deviation[..., 1] ** -2.0
        weight = np.where(row_used, np.concatenate([site_weight[:, 1:], site_weight], axis=1), 0.0)[..., None] * np.eye(
            noise.shape[1]
        )
    projected = matrix.transpose(0, 2, 1) @ weight
    normal = projected @ matrix
    # Two sites in line with the vehicle make the equations singular: keep them solvable, with a large covariance.
    ridge = 1e-15 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-300
    solved = np.linalg.solve(
        normal + ridge * np.eye(3), np.concatenate([projected @ right[..., None], projected], axis=2)
    )
    gain = solved[..., 1:]
    covariance = gain @ noise @ gain.transpose(0, 2, 1)
    origin = np.stack([panels.x[:, 0], panels.y[:, 0]], axis=1)
    return origin + solved[:, :2, 0], covariance[:, :2, :2]


def _bearing(measured: Array, panels: Panels) -> tuple[Array, Array, Array]:
    """Ground range (m), cosine and sine of the bearing that each site measured, (S, I)."""
    x, y = single_site(measured, panels)
    dx, dy = x - panels.x, y - panels.y
    ground = np.hypot(dx, dy)
    return ground, dx / ground, dy / ground


def _equations(measured: Array, panels: Panels) -> tuple[Array, Array]:
    """Matrix (S, 2I-1, 3) and right side (S, 2I-1) of Eq. (5), in coordinates relative to the first site."""
    ground, cosine, sine = _bearing(measured, panels)
    x, y = panels.x - panels.x[:, :1], panels.y - panels.y[:, :1]
    longer = ground - ground[:, :1]
    ranges = -2 * np.stack([x, y, longer], axis=-1)[:, 1:]
    angles = np.stack([sine, -cosine, np.zeros_like(sine)], axis=-1)
    range_side = (longer**2 - x**2 - y**2)[:, 1:]
    return np.concatenate([ranges, angles], axis=1), np.concatenate([range_side, sine * x - cosine * y], axis=1)


def _row_covariance(measured: Array, deviation: Array, panels: Panels) -> Array:
    """Covariance of the rows' errors that noise in each site's sine and range causes, (S, 2I-1, 2I-1).

    A range row errs by -2 r_i (dr_i - dr_1), an angle row by r_i dtheta_i; dr = (R / r) dR, and the bearing follows
    from sin(theta - broadside) = R s / r, which mixes a little of the range into the angle where the mast is high.
    """
    ground, _, _ = _bearing(measured, panels)
    slant, sine = measured[..., 1], measured[..., 0]
    count = measured.shape[1]
    stretch = slant / ground
    ahead = np.sqrt(np.maximum(ground**2 - (slant * sine) ** 2, 1.0))
    angle_by_sine = -ground * slant / ahead
    angle_by_range = ground * sine * (stretch**2 - 1) / ahead
    by_range = np.zeros((len(measured), 2 * count - 1, count))
    by_sine = np.zeros_like(by_range)
    others = np.arange(count - 1)
    by_range[:, others, others + 1] = -2 * ground[:, 1:] * stretch[:, 1:]
    by_range[:, others, 0] = 2 * ground[:, 1:] * stretch[:, :1]
    every = np.arange(count)
    by_range[:, count - 1 + every, every] = angle_by_range
    by_sine[:, count - 1 + every, every] = angle_by_sine
    spread = np.concatenate([by_range * deviation[:, None, :, 1], by_sine * deviation[:, None, :, 0]], axis=2)
    return np.asarray(spread @ spread.transpose(0, 2, 1))


def _velocity(
    position: Array,
    spread: Array,
    measured: Array,
    deviation: Array,
    used: BoolArray,
    panels: Panels,
    settings: FusionOptions,
) -> tuple[Array, Array]:
    """Most likely velocity at a position (Step 3 of ASI-BIP), (S, 2), and the covariance of both, (S, 4, 4).

    spread: covariance of the position, (S, 2, 2).
    """
    dx, dy, distance = panels.sight(position[:, :1], position[:, 1:])
    unit = np.stack([dx / distance, dy / distance], axis=-1)
    weight = np.where(used, deviation[..., 2], np.inf) ** -2.0
    weighted = (unit * weight[..., None]).transpose(0, 2, 1)
    alone = np.linalg.inv(weighted @ unit + settings.speed_prior_mps**-2 * np.eye(2))
    velocity = (alone @ (weighted @ measured[..., 2, None]))[..., 0]
    radial = (unit * velocity[:, None, :]).sum(axis=2)
    turning = (velocity[:, None, :] - radial[..., None] * unit) / distance[..., None]
    carried = -alone @ (weighted @ turning)
    cross = carried @ spread
    lower = alone + cross @ carried.transpose(0, 2, 1)
    return velocity, np.concatenate(
        [np.concatenate([spread, cross.transpose(0, 2, 1)], axis=2), np.concatenate([cross, lower], axis=2)], axis=1
    )
