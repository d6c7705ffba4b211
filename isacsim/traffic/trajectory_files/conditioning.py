"""How wide positions of a file must be smoothed for their noise, and evenly sampled motion made of them.

White noise of standard deviation s (m) at a rate f (Hz), smoothed with a Gaussian kernel of standard deviation w (s),
leaves s sqrt(3 / (8 sqrt(pi) f w^5)) = s sqrt(0.21 / (f w^5)) of noise in the acceleration, m/s2: the second derivative
of the kernel has the energy 3 / (8 sqrt(pi) w^5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.traffic.motion import condition

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

USUAL_S = 0.15
"""The standard deviation of the kernel that everything after a source uses, s."""
MOST_MPS2 = 0.3
"""Noise of the acceleration that is put up with, m/s2. A hard brake is 4 m/s2."""
ENERGY = 3.0 / (8.0 * np.sqrt(np.pi))
"""0.2116: see above."""
DENSE_S = 0.05
"""Motion is sampled at least this often, s."""
DECIMALS = 6
"""More decimals than this are no rounding."""
SAMPLED = 20_000
"""So many values show how a file is rounded."""


def acceleration_noise(noise_m: float, rate_hz: float, width_s: float) -> float:
    """Return the noise of the acceleration, m/s2, that white noise of positions, m, leaves."""
    return float(noise_m * np.sqrt(ENERGY / (rate_hz * width_s**5)))


def width_for(noise_m: float, rate_hz: float, most_mps2: float = MOST_MPS2) -> float:
    """Return the width of the kernel, s, that leaves at most so much noise in the acceleration; at least the usual."""
    return max(USUAL_S, float((noise_m**2 * ENERGY / (rate_hz * most_mps2**2)) ** 0.2))


def own_width(width_s: float) -> float:
    """Return the width, s, of the kernel that together with the usual one is as wide as `width_s`."""
    return float(np.sqrt(max(width_s**2 - USUAL_S**2, 0.0))) if width_s > USUAL_S * (1.0 + 1e-9) else 0.0


def rounding_of(*columns: Array) -> float:
    """Return to what the values are rounded, in their unit: 0.01, 0.1, ...; 0 where they are not."""
    values = np.concatenate([column[:: max(1, len(column) // SAMPLED)] for column in columns])
    for decimals in range(DECIMALS + 1):
        scaled = values * 10.0**decimals
        if (np.abs(scaled - np.rint(scaled)) < 1e-4).all():
            return float(10.0**-decimals)
    return 0.0


def noise_of_rounding(step_m: float) -> float:
    """Return the standard deviation of what rounding to a step changes, m."""
    return float(step_m / np.sqrt(12.0))


@dataclass(frozen=True)
class Sampling:
    """How states at steps of `period_s` become motion.

    per_step: samples a step. width_s: of the source's own kernel, s; 0 where positions stay as they are.
    """

    period_s: float
    per_step: int
    width_s: float

    @classmethod
    def of(cls, period_s: float, noise_m: float) -> Sampling:
        """Return the sampling for a file. noise_m: standard deviation of its positions, m."""
        per_step = max(1, int(np.ceil(period_s / DENSE_S - 1e-9)))
        width_s = own_width(width_for(noise_m, 1.0 / period_s))
        # A kernel narrower than the step between its samples is none.
        return cls(period_s, per_step, max(width_s, period_s / per_step) if width_s else 0.0)

    @property
    def step_s(self) -> float:
        """Time between two samples, s."""
        return self.period_s / self.per_step

    @property
    def total_width_s(self) -> float:
        """Width of this kernel and the usual one together, s."""
        return float(np.hypot(self.width_s, USUAL_S))

    def motion(self, step: IntArray, values: Array) -> tuple[Array, Array]:
        """Return values and their derivatives in time at every sample from the first step to the last, (m,) each.

        step: numbers of the steps, ascending, with at least two of them. values: (n,). Missing steps are interpolated.
        """
        whole = step[-1] - step[0] + 1 == len(step)
        samples = np.arange((step[-1] - step[0]) * self.per_step + 1) / self.per_step
        if self.width_s:
            dense = values if whole and self.per_step == 1 else _spline(step, values)(step[0] + samples)
            smooth, slope = (condition(dense, self.step_s, self.width_s, order) for order in (0, 1))
            return smooth, slope
        if whole and self.per_step == 1:
            return values, np.asarray(np.gradient(values, self.period_s))
        curve = _spline(step, values)
        at = step[0] + samples
        return np.asarray(curve(at)), np.asarray(curve(at, 1)) / self.period_s


def _spline(step: IntArray, values: Array) -> CubicSpline:
    from scipy.interpolate import CubicSpline  # loaded only here, because every command imports this module

    # Not-a-knot needs four points to be a cubic; a line through two of them is all that they say.
    return CubicSpline(step, values, bc_type="not-a-knot" if len(step) > 3 else "natural")
