"""Motion conditioning of vehicles that are still driving: piece by piece, from what SUMO has simulated so far.

Open loop, a recording is smoothed by a symmetric kernel that also looks ahead (`isacsim.traffic.motion`). A running
simulation has no future, so there are two ways here:

trailing    the same Gaussian kernel, cut off at 4 standard deviations. The sensed world trails the simulation by that
            much, 0.6 s; a weight of 6e-5 is lost.
causal      a gamma kernel of order 4 with the same standard deviation, which only looks back. The sensed world is as
            old as the kernel's mean, 0.3 s, but not symmetric: what begins abruptly is smeared backwards in time.

Velocity and acceleration are the kernel's derivatives, so the three agree at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from isac_cosim.base.arrays import Array

Conditioning = Literal["trailing", "causal"]
TRAILING_REACH = 4.0
"""Half-width of the trailing kernel, in standard deviations; the weight beyond is 6e-5."""
ORDER = 4
"""Order of the gamma kernel: with 4, the acceleration it gives is continuous however the simulation's steps."""
CAUSAL_REACH = 9.0
"""Length of the gamma kernel, in standard deviations; the weight beyond is 2e-5."""


@dataclass(frozen=True)
class Kernel:
    """A conditioning kernel for one recording step.

    lag_s: how much the newest state trails the simulation; behind_rows, ahead_rows: rows needed before and after an
    instant of the sensed world's clock. age_s: mean age of what is seen, which counts as latency.
    """

    kind: Conditioning
    width_s: float
    step_s: float

    @property
    def lag_s(self) -> float:
        """How far the newest instant that can be conditioned is behind the simulation, s."""
        return self.ahead_rows * self.step_s

    @property
    def ahead_rows(self) -> int:
        """Rows needed after an instant."""
        return int(np.ceil(TRAILING_REACH * self.width_s / self.step_s - 1e-9)) if self.kind == "trailing" else 0

    @property
    def behind_rows(self) -> int:
        """Rows needed before an instant."""
        reach = TRAILING_REACH if self.kind == "trailing" else CAUSAL_REACH
        return int(np.ceil(reach * self.width_s / self.step_s - 1e-9))

    @property
    def age_s(self) -> float:
        """Mean age of what the kernel gives when it is given, s: the latency of conditioning."""
        return self.lag_s if self.kind == "trailing" else ORDER * self.width_s / np.sqrt(ORDER)

    def weights(self, rows: Array, count: int) -> Array:
        """Return the weights of `count` rows of positions for the states at some instants, (3, m, count).

        Motion at constant acceleration gets its exact velocity and acceleration.
        rows: places of the instants among those rows, may be fractions, (m,). The first index is the derivative: 0, 1,
        2, per s and s2.
        """
        age = (np.asarray(rows)[:, None] - np.arange(count)) * self.step_s
        if self.kind == "trailing":
            u = age / self.width_s
            value = np.where(np.abs(age) <= self.ahead_rows * self.step_s + 1e-9, np.exp(-0.5 * u**2), 0.0)
            first, second = -u * value, (u**2 - 1.0) * value
        else:
            u = np.maximum(age, 0.0) / (self.width_s / np.sqrt(ORDER))
            decay = np.exp(-u)
            value = u**3 * decay
            first, second = (3.0 * u**2 - u**3) * decay, (6.0 * u - 6.0 * u**2 + u**3) * decay
        value /= value.sum(axis=1, keepdims=True)
        mean = (value * age).sum(axis=1)
        nothing, one = np.zeros(len(age)), np.ones(len(age))
        return np.stack(
            [
                value,
                _with_moments(first, value, age, np.stack([nothing, -one, -2.0 * mean], axis=1)),
                _with_moments(second, value, age, np.stack([nothing, nothing, 2.0 * one], axis=1)),
            ]
        )


def _with_moments(kernel: Array, value: Array, age: Array, moments: Array) -> Array:
    """Return weights in the shape of `kernel`, corrected so that they differentiate constant acceleration exactly.

    A kernel that is cut off would take a part of the position and of the speed for an acceleration.
    kernel, value, age: (m, count). moments: the sums over age^0, age^1 and age^2 that the weights get, (m, 3).
    """
    powers = np.stack([age**0, age, age**2], axis=1)
    # The size first, by the highest moment; then a small parabola under the smoothing kernel takes up the rest.
    highest = np.where(np.abs(moments).argmax(axis=1) == 2, 2, 1)
    rows = np.arange(len(age))
    size = moments[rows, highest] / (kernel * powers[rows, highest]).sum(axis=1)
    shaped = kernel * size[:, None]
    missing = moments - np.einsum("mc,mpc->mp", shaped, powers)
    gram = np.einsum("mpc,mc,mqc->mpq", powers, value, powers)
    parabola = np.linalg.solve(gram, missing[..., None])
    return np.asarray(shaped + (powers * parabola).sum(axis=1) * value)


def conditioned(positions: Array, weights: Array) -> Array:
    """Return x, y, vx, vy, ax, ay of vehicles, (V, 6, m), m, m/s, m/s2. positions: x, y of rows, m, (V, 2, count)."""
    base = positions[:, :, :1]
    smooth = np.einsum("vak,omk->voam", positions - base, weights, optimize=True)
    smooth[:, 0] += base
    vehicles, orders, axes, instants = smooth.shape
    return np.asarray(smooth.reshape(vehicles, orders * axes, instants))
