"""A smooth line along a road that a car can follow: the centre line of its lanes, with the corners rounded.

The centre line of a lane is a polygon. A vehicle that follows it at speed v turns at once at each vertex, which no car
can do. Where a corner asks for too much acceleration, the line is smoothed along its length with a Gaussian kernel,
as wide as the speed requires. Elsewhere it stays as it is.

An isolated corner of angle w (rad) smoothed with standard deviation L (m) has the curvature w / (sqrt(2 pi) L) (1/m),
and its tip moves inwards by w L / sqrt(2 pi) (m). A kernel that keeps the acceleration below A therefore moves the tip
by v^2 w^2 / (2 pi A): by 0.1 m for 3 degrees at 30 m/s and 3.5 m/s2, and by 1.2 m for 10 degrees.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from pydantic import Field
from scipy import fft
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from isacsim.arrays import Array, ComplexArray
from isacsim.settings import Settings

STEP_M = 0.5
"""Distance between the points of a line, m."""
WIDTHS_M = np.concatenate([[0.0], np.geomspace(STEP_M, 40.0, 18)])
"""Kernel widths (standard deviations) that are computed; those between are interpolated, m."""
REACH = 6.0
"""Half-width of the kernel, in standard deviations."""
GROWTH = 1.25
"""Factor by which a kernel that is too narrow is widened."""
ROUNDS = 30
"""Maximum number of times that kernels are widened. `GROWTH` to this power exceeds the widest kernel by far."""
SLOPE = 0.25
"""How fast the kernel width changes along the line at most, m per m, before it is smoothed over `BLEND_M`."""
BLEND_M = 3.0
"""Reach of the filter that smooths the kernel width along the line, m."""


class RoundingSettings(Settings):
    """How the corners of a road are rounded, and how motion on it is smoothed in time."""

    width_s: float = Field(
        0.15, gt=0.0, le=1.0, description="standard deviation of the Gaussian kernel that smooths motion in time, s"
    )
    lateral_mps2: float = Field(
        3.5,
        gt=0.0,
        le=9.0,
        description="corners of the road that take more acceleration than this are rounded, m/s2",
    )
    along_mps2: float = Field(
        0.5,
        gt=0.0,
        le=9.0,
        description="largest change of speed where lengths of lanes and of their shapes differ, m/s2",
    )
    max_shift_m: float = Field(
        1.0, ge=0.0, le=5.0, description="neither moves a vehicle by more than this, m; 0 leaves the road as it is"
    )


class Smoothing:
    """Values at every `STEP_M` of a line, smoothed along it with kernels of any width up to the widest."""

    def __init__(self, values: ComplexArray) -> None:
        """values: shape (n,), n > 1. Beyond its ends, the signal is continued by point reflection."""
        self.values = values
        pad = int(REACH * WIDTHS_M[-1] / STEP_M)
        padded = np.pad(values, pad, mode="reflect", reflect_type="odd")
        count = fft.next_fast_len(len(padded))
        # The kernel keeps a straight line, so that it can be taken off: the rest starts and ends at zero.
        trend = np.linspace(padded[0], padded[-1], len(padded))
        self._spectrum = fft.fft(padded - trend, count)
        self._phase = -2.0 * (np.pi * fft.fftfreq(count, STEP_M)) ** 2
        self._trend = trend[pad : pad + len(values)]
        self._inner = slice(pad, pad + len(values))
        self._level = cache(self._computed)

    def _computed(self, level: int) -> ComplexArray:
        if level == 0:
            return self.values
        return np.asarray(
            fft.ifft(self._spectrum * np.exp(self._phase * WIDTHS_M[level] ** 2))[self._inner] + self._trend
        )

    def at(self, widths_m: Array) -> ComplexArray:
        """Return the values smoothed with the width of each point, m, shape (n,): linear in the variance."""
        result = np.empty(len(widths_m), np.complex128)
        level = np.clip(np.searchsorted(WIDTHS_M, widths_m, side="right") - 1, 0, len(WIDTHS_M) - 2)
        for k in np.unique(level):
            mask = level == k
            low, high = WIDTHS_M[k] ** 2, WIDTHS_M[k + 1] ** 2
            share = (widths_m[mask] ** 2 - low) / (high - low)
            here, wider = self._level(int(k))[mask], self._level(int(k) + 1)[mask]
            result[mask] = here + share * (wider - here)
        return result

    def widest(self, max_shift_m: float) -> Array:
        """Return for each point the widest kernel that moves it by at most `max_shift_m`, m, shape (n,)."""
        result = np.full(len(self.values), WIDTHS_M[-1])
        open_, before = np.ones(len(self.values), bool), np.zeros(len(self.values))
        for k in range(1, len(WIDTHS_M)):
            moved = np.abs(self._level(k) - self.values)
            ends = open_ & (moved > max_shift_m)
            share = (max_shift_m - before[ends]) / (moved[ends] - before[ends])
            low, high = WIDTHS_M[k - 1] ** 2, WIDTHS_M[k] ** 2
            result[ends] = np.sqrt(low + share * (high - low))
            open_ &= ~ends
            before = moved
        return result


def rounding_widths(line: Smoothing, speeds: Array, width_s: float, limit_mps2: float, max_shift_m: float) -> Array:
    """Return the kernel width at each point of a line with which a car can follow it, m, shape (n,).

    speeds: with which the line is driven, m/s, shape (n,).
    width_s: standard deviation of the kernel that smooths the motion in time afterwards, s.
    The kernels are widened until no point takes more acceleration than `limit_mps2`, as far as no point moves by more
    than `max_shift_m`. The width is 0 away from such points.
    """
    need = np.zeros(len(speeds))
    if len(speeds) < 3 or (acceleration(line, need, speeds, width_s) <= limit_mps2).all():
        return need
    widest = line.widest(max_shift_m)
    roof = -_envelope(-widest)
    widths = need.copy()
    for _ in range(ROUNDS):
        short = acceleration(line, widths, speeds, width_s) > limit_mps2
        short &= (widths < 0.98 * roof) & (need < WIDTHS_M[-1])
        if not short.any():
            break
        need[short] = np.clip(GROWTH * np.maximum(need, widths)[short], 1.0, WIDTHS_M[-1])
        widths = _blended(np.minimum(_envelope(need), roof))
    # The filters reach as far as the roof was lowered, so that no width exceeds the widest one at its own point.
    return np.minimum(widths, widest)


_BOX = 2 * round(BLEND_M / STEP_M / 3) + 1
_SPAN = 3 * (_BOX - 1) + 1
"""Points that the filter of the kernel widths takes at once, and in all: it is a box, three times."""


def _envelope(need: Array) -> Array:
    """Return the smallest widths that change by at most `SLOPE`, and are sufficient within the filter's reach.

    With both signs turned: the largest widths that are nowhere too large.
    """
    ramp = SLOPE * STEP_M * np.arange(len(need))
    ahead = np.maximum.accumulate(need + ramp) - ramp
    back = np.maximum.accumulate(need[::-1] + ramp) - ramp
    return np.asarray(maximum_filter1d(np.maximum(ahead, back[::-1]), _SPAN, mode="nearest"))


def _blended(widths: Array) -> Array:
    for _ in range(3):
        widths = uniform_filter1d(widths, _BOX, mode="nearest")
    return np.where(widths > 1e-3, widths, 0.0)


def acceleration(line: Smoothing, widths_m: Array, speeds: Array, width_s: float) -> Array:
    """Return the acceleration of a vehicle that follows the smoothed line at the given speeds, m/s2, shape (n,)."""
    total = np.minimum(np.hypot(widths_m, width_s * speeds), WIDTHS_M[-1])
    path = line.at(total)
    bend = np.zeros(len(path))
    bend[1:-1] = np.abs(path[2:] - 2.0 * path[1:-1] + path[:-2]) / STEP_M**2
    return np.asarray(bend * speeds**2)
