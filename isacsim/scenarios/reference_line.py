"""A smooth line along a road that a car can follow: the centre line of its lanes, with the corners rounded.

The centre line of a lane is a polygon. A vehicle that follows it at speed v turns at once at each vertex, which no car
can do. Where a corner asks for too much acceleration, the line is smoothed along its length with a Gaussian kernel,
as wide as the speed requires. Elsewhere it stays as it is.

An isolated corner of angle w (rad) smoothed with standard deviation L (m) has the curvature w / (sqrt(2 pi) L) (1/m),
and its tip moves inwards by w L / sqrt(2 pi) (m). A kernel that keeps the acceleration below A therefore moves the tip
by v^2 w^2 / (2 pi A): by 0.1 m for 3 degrees at 30 m/s and 3.5 m/s2, and by 1.2 m for 10 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import Field
from scipy import fft
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from isac_cosim.base.arrays import Array, BoolArray, ComplexArray, IntArray, reflected
from isac_cosim.base.settings import Settings

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
        0.2,
        gt=0.0,
        le=9.0,
        description="largest change of speed where lengths of lanes and of their shapes differ, m/s2",
    )
    max_shift_m: float = Field(
        1.0, ge=0.0, le=5.0, description="neither moves a vehicle by more than this, m; 0 leaves the road as it is"
    )


class Smoothing:
    """Values at every `STEP_M` of a line, smoothed along it with kernels of any width up to the widest.

    widths_m: of the kernels that are computed, standard deviations, m.
    """

    def __init__(self, values: ComplexArray, widths_m: Array = WIDTHS_M) -> None:
        """values: shape (n,), n > 1. Beyond its ends, the signal is continued by point reflection.

        widths_m: from 0 on, ascending; the last one limits how widely the line can be smoothed.
        """
        self.values = values
        self.widths_m = widths_m
        self._variances = widths_m**2
        self._levels = np.empty((len(widths_m), len(values)), np.complex128)
        self._levels[0] = values
        self._computed = np.zeros(len(widths_m), bool)
        self._computed[0] = True

    @cached_property
    def _spectrum(self) -> _Spectrum:
        return _Spectrum.of(self.values, float(self.widths_m[-1]))

    def _compute(self, levels: IntArray) -> None:
        """Smooth the values with those of the widths that are not computed yet."""
        missing = levels[~self._computed[levels]]
        if len(missing):
            self._levels[missing] = self._spectrum.smoothed(self.widths_m[missing])
            self._computed[missing] = True

    def at(self, widths_m: Array, first: int = 0) -> ComplexArray:
        """Return the values at points from the first one on, smoothed with the width of each, m, shape (n,).

        Between the widths that are computed, they are linear in the variance.
        """
        level = np.minimum(self.widths_m.searchsorted(widths_m, side="right") - 1, len(self.widths_m) - 2)
        if not self._computed.all():
            self._compute(np.unique([level, level + 1]))
        low, high = self._variances[level], self._variances[level + 1]
        share = (widths_m**2 - low) / (high - low)
        points = np.arange(first, first + len(widths_m))
        here, wider = self._levels[level, points], self._levels[level + 1, points]
        return np.asarray(here + share * (wider - here))

    def widest(self, max_shift_m: float) -> Array:
        """Return for each point the widest kernel that moves it by at most `max_shift_m`, m, shape (n,)."""
        self._compute(np.arange(len(self.widths_m)))
        moved = np.abs(self._levels - self.values)
        beyond = moved > max_shift_m
        ends = np.flatnonzero(beyond.any(axis=0))
        level = beyond[:, ends].argmax(axis=0)
        before, after = moved[level - 1, ends], moved[level, ends]
        low, high = self._variances[level - 1], self._variances[level]
        result = np.full(len(self.values), self.widths_m[-1])
        result[ends] = np.sqrt(low + (max_shift_m - before) / (after - before) * (high - low))
        return result


@dataclass(frozen=True)
class _Spectrum:
    """The Fourier transform of a signal that is continued beyond its ends, and the straight line taken off before.

    The kernel keeps a straight line, so that it can be taken off: the rest starts and ends at zero.
    """

    values: ComplexArray
    line: ComplexArray
    inner: slice

    @classmethod
    def of(cls, values: ComplexArray, widest_m: float) -> Self:
        pad = int(REACH * widest_m / STEP_M)
        padded = reflected(values, pad, pad)
        count = fft.next_fast_len(len(padded))
        line = np.linspace(padded[0], padded[-1], len(padded))
        inner = slice(pad, pad + len(values))
        return cls(fft.fft(padded - line, count), line[inner], inner)

    def smoothed(self, widths_m: Array) -> ComplexArray:
        """Return the signal smoothed with Gaussian kernels of k standard deviations, m, shape (k, n)."""
        kernels = np.stack([_kernel_spectrum(len(self.values), width_m) for width_m in widths_m.tolist()])
        return np.asarray(fft.ifft(self.values * kernels)[:, self.inner] + self.line)


@lru_cache(maxsize=512)
def _kernel_spectrum(count: int, width_m: float) -> ComplexArray:
    """Return the Fourier transform of a Gaussian kernel of this standard deviation, m, shape (count,)."""
    spectrum = np.exp(-2.0 * (np.pi * fft.fftfreq(count, STEP_M)) ** 2 * width_m**2).astype(np.complex128)
    spectrum.flags.writeable = False
    return np.asarray(spectrum)


@dataclass(frozen=True)
class RoundedStretch:
    """A stretch of a line that is rounded.

    start: number of its first point. line: the stretch, at every `STEP_M`. widths: of the kernel at each point, m.
    """

    start: int
    line: Smoothing
    widths: Array

    @property
    def span(self) -> slice:
        """The points of the whole line that the stretch takes up."""
        return slice(self.start, self.start + len(self.widths))

    def smoothed(self, values: ComplexArray) -> ComplexArray:
        """Return other values along the whole line, smoothed as the stretch is, shape of the stretch."""
        return Smoothing(values[self.span], self.line.widths_m).at(self.widths)


def stretches(
    values: ComplexArray, speeds: Array, width_s: float, limit_mps2: float, max_shift_m: float
) -> list[RoundedStretch]:
    """Return the stretches of a line that have to be rounded, so that a car can follow it.

    values: at every `STEP_M` of the line, shape (n,). The other arguments are those of `rounding_widths`.
    Only the surroundings of sharp points are looked at. Most of them need narrow kernels, which reach less far than the
    widest one.
    """
    looked_at = values if values.imag.any() else values.real
    sharp = np.flatnonzero(~is_gentle(looked_at, speeds, width_s, limit_mps2))
    sharp = sharp[_may_be_sharp(looked_at, speeds, width_s, limit_mps2, sharp)]
    if not len(sharp):
        return []
    for widths_m in (WIDTHS_M[:NARROW], WIDTHS_M):
        widest, in_time = float(widths_m[-1]), width_s * float(speeds.max())
        enough = np.sqrt(max(widest**2 - in_time**2, 0.0)) - SLACK_M
        if widths_m is not WIDTHS_M and enough <= 0.0:
            continue
        reach = int((REACH * widest + widest / SLOPE + SURROUNDINGS_M) / STEP_M)
        rounded = []
        for part in np.split(sharp, np.flatnonzero(np.diff(sharp) > 2 * reach) + 1):
            start = max(int(part[0]) - reach, 0)
            span = slice(start, int(part[-1]) + reach + 1)
            line = Smoothing(values[span], widths_m)
            widths = rounding_widths(line, speeds[span], width_s, limit_mps2, max_shift_m)
            rounded.append(RoundedStretch(start, line, widths))
        if max(float(stretch.widths.max(initial=0.0)) for stretch in rounded) < enough:
            break
    return [stretch for stretch in rounded if stretch.widths.any()]


def is_gentle(values: ComplexArray | Array, speeds: Array, width_s: float, limit_mps2: float) -> BoolArray:
    """Return at which points a line clearly needs no rounding: a quick answer, which errs on the side of False.

    values: at every `STEP_M` of the line, shape (n,). The other arguments are those of `rounding_widths`.
    Instead of a Gaussian kernel, the bends are averaged by a box filter, applied three times, that is narrower. Points
    of nearly equal speed are averaged with one width.
    """
    bend = np.zeros(len(values))
    bend[1:-1] = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2]) / STEP_M**2
    gentle = speeds**2 * bend <= GENTLE * limit_mps2
    if gentle.all():
        return gentle
    gentle = speeds**2 * bend.max() <= GENTLE * limit_mps2
    rough = np.flatnonzero(~gentle)
    band = np.floor(np.log(np.maximum(speeds[rough], LEAST_MPS) / LEAST_MPS) / np.log(BAND)).astype(np.int64)
    for k in np.flatnonzero(np.bincount(band)):
        kernel_points = width_s * LEAST_MPS * BAND**k / STEP_M
        # Three boxes of n points have the variance (n^2 - 1) / 4.
        points = int(np.sqrt(4.0 * kernel_points**2 + 1.0) + 1) // 2 * 2 - 1
        rows = rough[band == k]
        first = max(int(rows[0]) - 3 * points, 0)
        mean = bend[first : rows[-1] + 3 * points + 1]
        for _ in range(3 if points > 1 else 0):
            # Told the type, scipy spends less time on it than on the filter.
            mean = uniform_filter1d(mean, points, output=np.float64, mode="nearest")
        gentle[rows] = speeds[rows] ** 2 * mean[rows - first] <= GENTLE * limit_mps2
    return np.asarray(gentle)


def _may_be_sharp(
    values: ComplexArray | Array, speeds: Array, width_s: float, limit_mps2: float, points: IntArray
) -> BoolArray:
    """Return which of some points, (k,), may need rounding, (k,): a closer look, with the Gaussian kernel itself.

    The other arguments are those of `rounding_widths`. Where points are many or their kernels narrow, all may.
    """
    width_points = width_s * speeds[points] / STEP_M
    reach = int(CLOSE_REACH * width_points.max(initial=0.0)) + 1
    around = np.arange(-reach, reach + 1)
    if len(points) * len(around) > CLOSE_VALUES or width_points.min(initial=np.inf) < CLOSE_LEAST_POINTS:
        return np.ones(len(points), bool)
    # The line bends neither at its ends nor beyond them.
    bend = np.zeros(len(values) + 2 * reach, values.dtype)
    bend[reach + 1 : -reach - 1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / STEP_M**2
    weights = np.exp(-0.5 * (around / width_points[:, None]) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    mean = np.einsum("kj,kj->k", weights, sliding_window_view(bend, len(around))[points])
    return np.asarray(speeds[points] ** 2 * np.abs(mean) > CLOSE * limit_mps2)


def rounding_widths(line: Smoothing, speeds: Array, width_s: float, limit_mps2: float, max_shift_m: float) -> Array:
    """Return the kernel width at each point of a line with which a car can follow it, m, shape (n,).

    speeds: with which the line is driven, m/s, shape (n,).
    width_s: standard deviation of the kernel that smooths the motion in time afterwards, s.
    The kernels are widened until no point takes more acceleration than `limit_mps2`, as far as no point moves by more
    than `max_shift_m`. The width is 0 away from such points.
    """
    need = np.zeros(len(speeds))
    if len(speeds) < 3:
        return need
    path = _path(line, need, speeds, width_s)
    short = _bending(path, speeds) > limit_mps2
    if not short.any():
        return need
    widest = line.widest(max_shift_m)
    roof = -_envelope(-widest)
    widths = need.copy()
    for _ in range(ROUNDS):
        short &= (widths < 0.98 * roof) & (need < line.widths_m[-1])
        if not short.any():
            break
        wider = np.maximum(GROWTH * np.maximum(need[short], widths[short]), 1.0)
        need[short] = np.minimum(wider, line.widths_m[-1])
        before, widths = widths, _blended(np.minimum(_envelope(need), roof))
        # Most of the line keeps its width, and is not smoothed again.
        changed = np.flatnonzero(widths != before)
        if len(changed):
            part = slice(int(changed[0]), int(changed[-1]) + 1)
            path[part] = _path(line, widths[part], speeds[part], width_s, part.start)
        short = _bending(path, speeds) > limit_mps2
    # The filters reach as far as the roof was lowered, so that no width exceeds the widest one at its own point.
    return np.minimum(widths, widest)


NARROW = 14
"""Number of the kernel widths that are tried first, from 0 to 14.3 m."""
SLACK_M = 2.0
"""A line whose kernels stay narrower than the widest one by this is rounded as if there were no widest one, m."""
SURROUNDINGS_M = 15.0
"""How far the sharp points that the quick estimate tells may lie from those that are sharp, m."""
GENTLE = 0.7
"""A line is gentle if the quick estimate of its acceleration is at most this share of the limit."""
CLOSE = 0.95
"""The same of the closer look. Widths between those computed are interpolated, which raises a peak by up to 2.5 %."""
CLOSE_REACH = 5.0
"""Half-width of the kernel of the closer look, in standard deviations."""
CLOSE_VALUES = 100_000
"""The closer look is taken where it needs at most so many values of the line; otherwise it would take longest."""
CLOSE_LEAST_POINTS = 2.0
"""No kernel is narrower than this in the closer look, in points of the line."""
LEAST_MPS = 1.0
"""At lower speeds than this, the quick estimate smooths nothing, m/s."""
BAND = 1.5
"""Ratio of the speeds that the quick estimate treats as equal."""
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
    return np.asarray(maximum_filter1d(np.maximum(ahead, back[::-1]), _SPAN, output=np.float64, mode="nearest"))


def _blended(widths: Array) -> Array:
    for _ in range(3):
        widths = uniform_filter1d(widths, _BOX, output=np.float64, mode="nearest")
    return np.where(widths > 1e-3, widths, 0.0)


def acceleration(line: Smoothing, widths_m: Array, speeds: Array, width_s: float) -> Array:
    """Return the acceleration of a vehicle that follows the smoothed line at the given speeds, m/s2, shape (n,)."""
    return _bending(_path(line, widths_m, speeds, width_s), speeds)


def _path(line: Smoothing, widths_m: Array, speeds: Array, width_s: float, first: int = 0) -> ComplexArray:
    """Return where a vehicle drives that follows the smoothed line, from its first point on, m, shape (n,)."""
    return line.at(np.minimum(np.hypot(widths_m, width_s * speeds), line.widths_m[-1]), first)


def _bending(path: ComplexArray, speeds: Array) -> Array:
    """Return the acceleration that the bends of a path, at every `STEP_M`, take at these speeds, m/s2, shape (n,)."""
    bend = np.zeros(len(path))
    bend[1:-1] = np.abs(path[2:] - 2.0 * path[1:-1] + path[:-2]) / STEP_M**2
    return np.asarray(bend * speeds**2)
