"""Maximum likelihood: a coarse search over cells and half cells, then Fisher scoring from the strongest."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo import Bins, Moments, draw_moments, draw_search, fourth_moment, spread
from isac_cosim.isacsim.radio.estimation import (
    SCORING_STEPS,
    Estimates,
    beaten_by_rival,
    estimated_snr,
    in_chunks,
    strongest,
)
from isac_cosim.isacsim.radio.waveform import Waveform

if TYPE_CHECKING:
    import torch

SEARCH_FLOOR = 0.01
"""Per-element SNR (-20 dB) from which the coarse search cannot fail.

Half-way between cells a search cell keeps 0.81 of the power along an axis, so at -20 dB the peak is at least 228 times
the noise, and noise exceeds it with a probability below 1e-20 a snapshot.
"""
AT_ONCE = 8192
"""Most echoes whose likelihoods are climbed at once: what the steps read and write fits into a processor's cache."""


class MaximumLikelihood:
    """Maximum likelihood of one target; on the Cramer-Rao bound above its threshold of -28 dB."""

    label = "maximum likelihood"

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw moments, and DFT blocks only where the search can fail."""
        offset, power = maximum_likelihood(draw_moments(snr, waveform, rng), waveform)
        estimates = Estimates(cells + offset, power)
        doubtful = np.flatnonzero(snr < SEARCH_FLOOR)
        if len(doubtful):
            searched = in_chunks(
                len(doubtful),
                lambda part: _with_search(cells[doubtful[part]], snr[doubtful[part]], waveform, rng),
            )
            estimates.cells[doubtful], estimates.power[doubtful] = searched.cells, searched.power
        return estimates

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Search the cells and half cells of each full echo, and score from the strongest."""
        from isac_cosim.isacsim.radio.estimators import on_tensor

        return on_tensor.maximum_likelihood(echo)

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """The Cramer-Rao bound at the estimated SNR."""
        return cell_bound(estimated_snr(power, waveform), waveform)


def maximum_likelihood(moments: Moments, waveform: Waveform) -> tuple[Array, Array]:
    """Climb to the maximum of the likelihood in the main lobe: offset from the true cells, (B, 3), and power, (B,).

    Fisher scoring on |s(t)|^2, s the matched filter at the scaled offset t, t_i <- t_i + Re(s* ds/dt_i) / |s|^2:
    the step Im(s'/s) 12/(N^2-1) in scaled units. Started at the truth, it ends where scoring on the full echo ends.
    """
    count = len(moments.amplitude)
    offset, power = np.empty((3, count)), np.empty(count)
    for begin in range(0, count, AT_ONCE):
        piece = slice(begin, begin + AT_ONCE)
        part = Moments(moments.amplitude[piece], moments.noise[:, piece])
        offset[:, piece], power[piece] = _climbed(part, waveform)
    return offset.T, power


def _climbed(moments: Moments, waveform: Waveform) -> tuple[Array, Array]:
    """Climb as `maximum_likelihood` does, from few snapshots: offset from the true cells, (3, B), and power, (B,)."""
    # All factors are real: real and imaginary parts of their own take less than half the time of complex numbers.
    noise = np.stack([moments.noise.real, moments.noise.imag], axis=1)
    value = noise[0]
    value[0] += moments.amplitude
    fourth = np.array([fourth_moment(n) for n in waveform.shape])[:, None]
    scaled = np.zeros((3, len(moments.amplitude)))
    power = np.zeros(len(moments.amplitude))
    for _ in range(SCORING_STEPS):
        filtered, slopes = _matched_filter(scaled, value, noise[1:], fourth)
        power = filtered[0] ** 2 + filtered[1] ** 2
        step = (filtered[0] * slopes[:, 0] + filtered[1] * slopes[:, 1]) / power
        # A deep fade of the matched filter would throw the iteration out of the main lobe.
        scaled = np.clip(scaled + step, -1.5, 1.5)
    cells_per_scaled = np.array([n / (2 * np.pi * spread(n)) for n in waveform.shape])
    return scaled * cells_per_scaled[:, None], power


def _matched_filter(scaled: Array, value: Array, noise: Array, fourth: Array) -> tuple[Array, Array]:
    """The matched filter at scaled offsets (3, B) and its three slopes: (2, B) and (3, 2, B), real and imaginary parts.

    A steering vector moved by t along an axis is c0(t) p0 + c1(t) p1 + c2(t) p2 in the axis' polynomials (and higher
    ones, left out): c0 is the Dirichlet kernel, c1 = -c0', both to the fourth order, and c2 to the second.
    value: the target and the noise of degree zero, (2, B). noise: of the other nine moments, (9, 2, B).
    """
    square = scaled**2
    flat = 1 - square / 2 + fourth / 24 * square**2
    tilt = scaled * (1 - fourth / 6 * square)
    tilt_slope = 1 - fourth / 2 * square
    curve = np.sqrt(fourth - 1)
    bend, bend_slope = curve / 2 * square, curve * scaled
    filtered = value * (flat[0] * flat[1] * flat[2])
    slopes = np.empty((3, *value.shape))
    along = [noise[i] * tilt[i] + noise[3 + _PURE[i]] * bend[i] for i in range(3)]
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        across = noise[3 + _MIXED[i]]
        others, tilts = flat[j] * flat[k], tilt[j] * tilt[k]
        filtered += along[i] * others + across * (tilts * flat[i])
        slopes[i] = (noise[i] * tilt_slope[i] + noise[3 + _PURE[i]] * bend_slope[i] - value * tilt[i]) * others
        # The other axes' first and second degrees, and their product, fall off along this axis as the target does.
        slopes[i] -= tilt[i] * (along[j] * flat[k] + along[k] * flat[j] + across * tilts)
        slopes[i] += tilt_slope[i] * (
            noise[3 + _MIXED[k]] * (tilt[j] * flat[k]) + noise[3 + _MIXED[j]] * (tilt[k] * flat[j])
        )
    return filtered, slopes


_PURE = (0, 3, 5)
"""Place of the second degree of each axis among the six curvatures of DEGREES."""
_MIXED = (4, 2, 1)
"""Place of the product of the other two axes' first degrees."""


def _with_search(cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    """Maximum likelihood with its coarse search: where noise is stronger than the target, the estimate is noise."""
    bins, moments = draw_search(cells, snr, waveform, rng)
    place, height = strongest_pairs(bins)
    offset, power = maximum_likelihood(moments, waveform)
    estimate = cells + offset
    # A cell of the block that is off the main lobe is noise, too; refining it moves it within its own cell.
    astray = np.any(np.abs(place - cells) > 1, axis=1)
    estimate[astray] = place[astray] + rng.uniform(-0.25, 0.25, (int(astray.sum()), 3))
    return beaten_by_rival(Estimates(estimate, np.where(astray, height, power)), height, bins)


def strongest_pairs(bins: Bins) -> tuple[Array, Array]:
    """Find the strongest of the cells and of the half cells between them: place in cells (B, 3), and power (B,).

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
        place, power = strongest(values)
        better = power > best_power
        best_power[better] = power[better]
        best_place[better] = place[better] + 0.5 * np.array(half)
    return bins.first + best_place, best_power
