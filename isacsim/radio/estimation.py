"""Angle, delay and Doppler from the statistics of an echo: maximum likelihood, Candan, plain and padded grid.

Everything is in cells (see `isacsim.radio.waveform`). The same estimators on the full tensor are in
`isacsim.radio.echo_tensor`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import numpy.typing as npt

from isacsim.arrays import Array, ComplexArray
from isacsim.radio.bounds import cell_bound
from isacsim.radio.echo import Bins, Moments, Search, draw_bins, draw_moments, draw_search, fourth_moment, spread
from isacsim.radio.waveform import Waveform

Estimator = Literal["ml", "candan", "grid", "padded_grid"]

SEARCH_FLOOR = 0.01
"""Per-element SNR (-20 dB) from which the coarse search of `ml` cannot fail.

Half-way between cells a search cell keeps 0.81 of the power an axis, so at -20 dB the peak is at least 228 times the
noise, and noise above it has a probability below 1e-20 a snapshot.
"""

SCORING_STEPS = 4
_CHUNK = 1024
_GRID_OF: dict[Estimator, Search] = {"ml": "pairs", "candan": "whole", "grid": "whole", "padded_grid": "half"}


@dataclass(frozen=True)
class Estimates:
    """cells: estimated coordinates, (B, 3). power: of the estimated target, units of the noise after coherent
    processing, (B,)."""

    cells: Array
    power: Array


def observe(cells: Array, snr: Array, estimator: Estimator, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    """Draw one echo a target by the DFT window and estimate from it.

    cells: true coordinates, (B, 3). snr: per-element, linear, (B,).
    """
    if estimator != "ml":
        parts = [_from_bins(cells[k], snr[k], estimator, waveform, rng) for k in _chunks(len(snr))]
        return _joined(parts)
    offset, power = maximum_likelihood(draw_moments(snr, waveform, rng), waveform)
    found = Estimates(cells + offset, power)
    doubtful = np.flatnonzero(snr < SEARCH_FLOOR)
    for k in _chunks(len(doubtful)):
        rows = doubtful[k]
        drawn = _with_search(cells[rows], snr[rows], waveform, rng)
        found.cells[rows], found.power[rows] = drawn.cells, drawn.power
    return found


def maximum_likelihood(moments: Moments, waveform: Waveform) -> tuple[Array, Array]:
    """Maximum of the likelihood in the main lobe: offset from the true coordinates, (B, 3) cells, and power, (B,).

    Fisher scoring on |s(t)|^2, s the matched filter at the scaled offset t, t_i <- t_i + Re(s* ds/dt_i) / |s|^2:
    the step Im(s'/s) 12/(N^2-1) in scaled units. Started at the truth, it ends where scoring on the full echo ends.
    """
    value = moments.amplitude + moments.noise[0]
    fourth = np.array([fourth_moment(n) for n in waveform.shape])[:, None]
    scaled = np.zeros((3, len(value)))
    power = np.zeros(len(value))
    for _ in range(SCORING_STEPS):
        filtered, slopes = _matched_filter(scaled, value, moments.noise[1:], fourth)
        power = filtered.real**2 + filtered.imag**2
        step = (filtered.real * slopes.real + filtered.imag * slopes.imag) / power
        # A deep fade of the matched filter would throw the iteration out of the main lobe.
        scaled = np.clip(scaled + step, -1.5, 1.5)
    cells_per_scaled = np.array([n / (2 * np.pi * spread(n)) for n in waveform.shape])
    return (scaled * cells_per_scaled[:, None]).T, power


def _matched_filter(
    scaled: Array, value: ComplexArray, noise: ComplexArray, fourth: Array
) -> tuple[ComplexArray, ComplexArray]:
    """The matched filter at scaled offsets (3, B) and its three slopes: (B,) and (3, B).

    A steering vector moved by t along an axis is c0(t) p0 + c1(t) p1 + c2(t) p2 in the axis' polynomials (and higher
    ones, left out): c0 is the Dirichlet kernel, c1 = -c0', both to the fourth order, and c2 to the second.
    value: the target and the noise of degree zero, (B,). noise: of the other nine moments, (9, B).
    """
    square = scaled**2
    flat = 1 - square / 2 + fourth / 24 * square**2
    tilt = scaled * (1 - fourth / 6 * square)
    tilt_slope = 1 - fourth / 2 * square
    curve = np.sqrt(fourth - 1)
    bend, bend_slope = curve / 2 * square, curve * scaled
    filtered = value * (flat[0] * flat[1] * flat[2])
    slopes = np.empty((3, len(value)), dtype=np.complex128)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        own = noise[i] * tilt[i] + noise[3 + _PURE[i]] * bend[i]
        across = noise[3 + _MIXED[i]]
        others = flat[j] * flat[k]
        filtered += own * others + across * (tilt[j] * tilt[k] * flat[i])
        slopes[i] = (noise[i] * tilt_slope[i] + noise[3 + _PURE[i]] * bend_slope[i] - value * tilt[i]) * others
        # The other axes' first and second degrees, and their product, fall off along this axis as the target does.
        slopes[i] -= tilt[i] * (
            (noise[j] * tilt[j] + noise[3 + _PURE[j]] * bend[j]) * flat[k]
            + (noise[k] * tilt[k] + noise[3 + _PURE[k]] * bend[k]) * flat[j]
            + across * (tilt[j] * tilt[k])
        )
        slopes[i] += tilt_slope[i] * (
            noise[3 + _MIXED[k]] * (tilt[j] * flat[k]) + noise[3 + _MIXED[j]] * (tilt[k] * flat[j])
        )
    return filtered, slopes


_PURE = (0, 3, 5)
"""Place of the second degree of each axis among the six curvatures of DEGREES."""
_MIXED = (4, 2, 1)
"""Place of the product of the other two axes' first degrees."""


def _with_search(cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    """Maximum likelihood with its coarse search: where noise outshines the target, the estimate is noise."""
    bins, moments = draw_search(cells, snr, waveform, rng)
    place, height = strongest_pairs(bins)
    offset, power = maximum_likelihood(moments, waveform)
    estimate = cells + offset
    # A cell of the block that is not on the main lobe is noise as well; refining it moves it within its own cell.
    astray = np.any(np.abs(place - cells) > 1, axis=1)
    estimate[astray] = place[astray] + rng.uniform(-0.25, 0.25, (int(astray.sum()), 3))
    power = np.where(astray, height, power)
    return _beaten_by_rival(Estimates(estimate, power), height, bins)


def _beaten_by_rival(found: Estimates, height: Array, bins: Bins) -> Estimates:
    """The estimates, replaced by the rival where it exceeds the peak of the drawn cells, `height` (B,)."""
    lost = bins.rival.power > height
    return Estimates(
        np.where(lost[:, None], bins.rival.cells, found.cells), np.where(lost, bins.rival.power, found.power)
    )


def strongest_pairs(bins: Bins) -> tuple[Array, Array]:
    """The strongest of the cells and the half cells between them: place in cells (B, 3), and power (B,).

    Half-way between two cells, (Y[k] + Y[k+1]) / sqrt(2) has the noise of one cell and 0.81 of the target's power,
    against 0.41 of either: the search loses at most 2.7 dB instead of 11.7.
    """
    best_power = np.zeros(len(bins.values))
    best_place = np.zeros((len(bins.values), 3))
    for half in product((False, True), repeat=3):
        values = bins.values
        for axis in (k for k in range(3) if half[k]):
            low = (slice(None),) * (axis + 1) + (slice(None, -1),)
            high = (slice(None),) * (axis + 1) + (slice(1, None),)
            values = (values[low] + values[high]) * np.sqrt(0.5)
        place, power = _strongest(values)
        better = power > best_power
        best_power[better] = power[better]
        best_place[better] = place[better] + 0.5 * np.array(half)
    return bins.first + best_place, best_power


def _strongest(values: ComplexArray) -> tuple[npt.NDArray[np.int64], Array]:
    """Index (B, 3) and power (B,) of the largest of values (B, a, b, c)."""
    power = (values.real**2 + values.imag**2).reshape(len(values), -1)
    flat = power.argmax(axis=1)
    index = np.stack(np.unravel_index(flat, values.shape[1:]), axis=1)
    return index, power[np.arange(len(values)), flat]


def _from_bins(
    cells: Array, snr: Array, estimator: Estimator, waveform: Waveform, rng: np.random.Generator
) -> Estimates:
    """The peak cell (`grid`, `padded_grid`), refined from its neighbours (`candan`)."""
    bins = draw_bins(cells, snr, _GRID_OF[estimator], waveform, rng)
    index, height = _strongest(bins.values)
    place = bins.first + index * bins.spacing
    if estimator == "candan":
        offset = _candan(bins, index, waveform)
        return _beaten_by_rival(Estimates(place + offset, height / _kept(offset, waveform)), height, bins)
    return _beaten_by_rival(Estimates(place, height), height, bins)


def _candan(bins: Bins, index: npt.NDArray[np.int64], waveform: Waveform) -> Array:
    """Offset from the peak cell by its two neighbours along each axis, cells, (B, 3).

    Source: Candan, IEEE Signal Process. Lett. 18 (2011), with the arctangent of the 2013 refinement.
    """
    rows = np.arange(len(index))
    offset = np.empty(index.shape)
    for axis, count in enumerate(waveform.shape):
        # At the edge of the block the peak is noise, and so is what its inner neighbours say of it.
        middle = index.copy()
        middle[:, axis] = np.clip(index[:, axis], 1, bins.values.shape[axis + 1] - 2)
        unit = np.eye(3, dtype=np.int64)[axis]
        low, peak, high = (bins.values[(rows, *(middle + k * unit).T)] for k in (-1, 0, 1))
        offset[:, axis] = candan_offset(low, peak, high, count)
    return offset


def _kept(offset: Array, waveform: Waveform) -> Array:
    """Share of a target's power that the cell at `offset` (B, 3) from it keeps: Dirichlet kernels squared, (B,)."""
    kept = np.ones(len(offset))
    for axis, count in enumerate(waveform.shape):
        kept *= (np.sinc(offset[:, axis]) / np.sinc(offset[:, axis] / count)) ** 2
    return kept


def candan_offset(low: ComplexArray, peak: ComplexArray, high: ComplexArray, count: int) -> Array:
    """Candan's offset in cells from three neighbouring cells of an axis of `count`, phases about the centre."""
    turn = np.exp(1j * np.pi / count)
    # Counted from the first element, neighbouring cells alternate in sign and turn by half an element's phase.
    low, high = -low / turn, -high * turn
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(((low - high) / (2 * peak - low - high)).real)
    offset = count / np.pi * np.arctan(np.tan(np.pi / count) * ratio)
    return np.asarray(np.clip(offset, -0.7, 0.7))


def estimate_deviation(power: Array, estimator: Estimator, waveform: Waveform) -> Array:
    """What the receiver takes as the standard deviation of its estimates, cells, (B, 3), from the estimated power (B,).

    The bound at the estimated SNR for `ml`, 2.15 times it for `candan`, and the width of a cell, uniform, besides for
    the grids.
    """
    # The maximum over amplitude, phase and three frequencies exceeds the target's own power by 2.5 on average.
    snr = np.maximum(power - 2.5, 0.5) / waveform.size
    bound = cell_bound(snr, waveform)
    if estimator == "ml":
        return bound
    if estimator == "candan":
        return 2.15 * bound
    width = 1.0 if estimator == "grid" else 0.5
    return np.asarray(np.sqrt(bound**2 + width**2 / 12))


def _chunks(count: int) -> list[slice]:
    return [slice(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK)]


def _joined(parts: list[Estimates]) -> Estimates:
    return Estimates(np.concatenate([p.cells for p in parts]), np.concatenate([p.power for p in parts]))
