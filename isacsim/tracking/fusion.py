"""Fusion: position and velocity of one vehicle from several sites that measured it at the same instant.

This module says what a fusion method must do and holds the default one, joint maximum likelihood. What a site measures
of a vehicle is in `isacsim.panels`; the choice of a method in `isacsim.tracking.fusion_methods`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.panels import Panels


class FusionOptions(Settings):
    """Options of the fusion methods; each reads those that concern it."""

    steps: int = Field(2, ge=1, le=10, description="Gauss-Newton steps of `information`.")
    eq5_weights: Literal["paper", "covariance"] = Field(
        "paper",
        description="Weights of `eq5`. paper: one variance for range and angle of a site. covariance: that of "
        "the rows.",
    )
    speed_prior_mps: float = Field(
        60.0,
        gt=0,
        le=1e7,
        description="Standard deviation of a vehicle's velocity along either axis, so that lines of sight that are "
        "parallel leave a fix with a wide, finite covariance.",
    )


@dataclass(frozen=True)
class Fixes:
    """Fixes of one vehicle at S instants.

    state: x, y (m), vx, vy (m/s), (S, 4). covariance: (S, 4, 4). valid: whether there is a fix, (S,).
    """

    state: Array
    covariance: Array
    valid: BoolArray

    def part(self, instants: slice) -> Fixes:
        """Return the fixes of some of the instants."""
        return Fixes(self.state[instants], self.covariance[instants], self.valid[instants])


class FusionMethod(Protocol):
    """A way of fusing several sites' measurements into one fix; a function, or any other callable."""

    def __call__(
        self, measured: Array, deviation: Array, used: BoolArray, panels: Panels, settings: FusionOptions, /
    ) -> Fixes:
        """Fuse the measurements of each instant.

        measured: sine, range (m), radial velocity (m/s), (S, I, 3). deviation: their standard deviations, same shape.
        used: which echoes take part, (S, I). panels: of each echo, (S, I).
        Returns a fix for each instant with an honest covariance. Where the echoes in use do not suffice, it is not
        valid (see `checked`); nothing is ever NaN.
        """


def fuse(measured: Array, deviation: Array, used: BoolArray, panels: Panels, settings: FusionOptions) -> Fixes:
    """Fuse by joint maximum likelihood of position and velocity at each instant, by Gauss-Newton.

    Arguments and result as in FusionMethod. One echo is enough for a position; the velocity across its line of sight is
    then the prior's.
    """
    weight = np.where(used[..., None], deviation, np.inf) ** -2.0
    state = np.zeros((len(measured), 4))
    state[:, :2] = _first_position(measured, weight, used, panels)
    # A weight for each number of the Jacobian: a product with three weights for twelve numbers is slower.
    spread = np.repeat(weight.reshape(len(state), -1), 4, axis=1).reshape(len(state), -1, 4)
    idle = weight.sum(axis=(1, 2)) == 0
    for _ in range(settings.steps):
        predicted = panels.measured(state)
        information, weighted = _information(state, predicted, spread, idle, panels, settings)
        gradient = _gradient(state, measured - predicted, weighted, settings)
        state = state + np.linalg.solve(information, gradient[..., None])[..., 0]
    information, _ = _information(state, panels.measured(state), spread, idle, panels, settings)
    return sound_fixes(state, np.asarray(np.linalg.inv(information)), np.asarray(used.any(axis=1)))


def sound_fixes(state: Array, covariance: Array, valid: BoolArray) -> Fixes:
    """Make fixes whose covariances are symmetric; one that is not valid is at the origin with (1e4 m)^2.

    Arguments as the fields of Fixes. A fix with a number that is not finite is not valid.
    """
    valid = valid & np.isfinite(state).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    return Fixes(
        np.where(valid[:, None], state, 0.0), np.where(valid[:, None, None], covariance, 1e8 * np.eye(4)), valid
    )


def information_of(state: Array, deviation: Array, panels: Panels) -> Array:
    """Fisher information about (x, y, vx, vy) in the sites' measurements, (S, 4, 4).

    state: (S, 4). deviation: of sine, range and radial velocity, (S, I, 3).
    """
    rows = jacobian(state, panels.measured(state), panels).reshape(len(state), -1, 4)
    return np.asarray((rows * deviation.reshape(len(state), -1, 1) ** -2.0).transpose(0, 2, 1) @ rows)


def position_bound(state: Array, deviation: Array, panels: Panels) -> Array:
    """Cramer-Rao bound of x, y (m), vx, vy (m/s), estimated jointly from all sites' echoes of one instant.

    state: true x, y, vx, vy, (S, 4). deviation: bounds of each echo's sine, range and radial velocity, (S, I, 3), as
    `isacsim.radio.bounds.measured_bound` gives them. Returns covariances, (S, 4, 4).
    """
    return np.asarray(np.linalg.inv(information_of(state, deviation, panels)))


def single_site(measured: Array, panels: Panels) -> tuple[Array, Array]:
    """Position x, y that each site's sine and slant range give by themselves, m, (S, I), its height considered.

    measured: (S, I, 3). Of the two possible points the one in front of the panel is taken: it sees nothing behind it.
    """
    along = measured[..., 0] * measured[..., 1]
    ahead = np.sqrt(np.maximum(measured[..., 1] ** 2 - along**2 - panels.height_m**2, 1.0))
    x = panels.x + along * panels.right[..., 0] + ahead * panels.front[..., 0]
    y = panels.y + along * panels.right[..., 1] + ahead * panels.front[..., 1]
    return x, y


def _first_position(measured: Array, weight: Array, used: BoolArray, panels: Panels) -> Array:
    """Mean of the sites' single positions, weighted by their information u u^T / sr^2 + n n^T / (r st)^2, (S, 2)."""
    x, y = single_site(measured, panels)
    dx, dy, distance = panels.sight(x, y)
    ground = np.hypot(dx, dy)
    ux, uy = dx / ground, dy / ground
    along, across = weight[..., 1], weight[..., 0] / distance**2
    xx = along * ux**2 + across * uy**2
    xy = (along - across) * ux * uy
    yy = along * uy**2 + across * ux**2
    right = np.stack([(xx * x + xy * y).sum(axis=1), (xy * x + yy * y).sum(axis=1)], axis=-1)
    idle = ~used.any(axis=1)
    a, b, c = xx.sum(axis=1) + idle, xy.sum(axis=1), yy.sum(axis=1) + idle
    first = c * right[:, 0] - b * right[:, 1]
    second = a * right[:, 1] - b * right[:, 0]
    return np.asarray(np.stack([first, second], axis=-1) / (a * c - b**2)[:, None])


def jacobian(state: Array, predicted: Array, panels: Panels) -> Array:
    """Derivatives of sine, range and radial velocity with respect to x, y, vx, vy at a state (S, 4), (S, I, 3, 4)."""
    dx, dy, distance = panels.sight(state[:, 0, None], state[:, 1, None])
    rows = np.zeros((*distance.shape, 3, 4))
    # Each axis by itself: long loops over instants are faster than short ones over the axes.
    for axis, offset in enumerate((dx, dy)):
        unit = offset / distance
        rows[..., 0, axis] = (panels.right[..., axis] - predicted[..., 0] * unit) / distance
        rows[..., 1, axis] = unit
        rows[..., 2, axis] = (state[:, 2 + axis, None] - predicted[..., 2] * unit) / distance
        rows[..., 2, 2 + axis] = unit
    return rows


def _information(
    state: Array, predicted: Array, weight: Array, idle: BoolArray, panels: Panels, settings: FusionOptions
) -> tuple[Array, Array]:
    """Fisher information about a state with the velocity's prior, (S, 4, 4), and the weighted Jacobian, (S, 4, 3 I).

    weight: of each number of the Jacobian, (S, 3 I, 4). idle: instants without an echo, (S,).
    """
    rows = jacobian(state, predicted, panels).reshape(len(state), -1, 4)
    weighted = (rows * weight).transpose(0, 2, 1)
    information = weighted @ rows
    prior = settings.speed_prior_mps**-2
    information[:, 2, 2] += prior
    information[:, 3, 3] += prior
    # Without an echo there is no information about the position: keep the matrix regular, the caller drops the fix.
    information[idle, :2, :2] += np.eye(2)
    return information, weighted


def _gradient(state: Array, residual: Array, weighted: Array, settings: FusionOptions) -> Array:
    """Gradient of the log-likelihood with the velocity's prior at a state, (S, 4). residual: (S, I, 3)."""
    gradient = (weighted @ residual.reshape(len(state), -1, 1))[..., 0]
    gradient[:, 2:] -= settings.speed_prior_mps**-2 * state[:, 2:]
    return np.asarray(gradient)
