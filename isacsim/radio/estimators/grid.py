"""Grid estimators: the strongest cell of the DFT, plain or padded, or a parabola through it and its neighbours.

ASI-BIP asks for a "grid-based three-dimensional discrete Fourier transform" and says no more. Padding and the parabola
are readings of it.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo import Bins, Search, draw_bins
from isac_cosim.isacsim.radio.estimation import Estimates, beaten_by_rival, estimated_snr, in_chunks, strongest
from isac_cosim.isacsim.radio.waveform import Waveform

if TYPE_CHECKING:
    import torch


class Grid:
    """The strongest cell of the DFT."""

    label = "grid"

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw DFT blocks of whole cells and take the strongest."""
        return _observe(cells, snr, "whole", waveform, rng)

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Take the strongest cell of each full echo's DFT."""
        from isac_cosim.isacsim.radio.estimators import on_tensor

        return on_tensor.grid(echo)

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """The bound at the estimated SNR and a uniform error over a cell."""
        return _deviation(power, waveform, 1.0)


class PaddedGrid:
    """The strongest cell of the DFT padded twofold along each axis: half cells."""

    label = "grid, padded twofold"

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw DFT blocks of half cells and take the strongest."""
        return _observe(cells, snr, "half", waveform, rng)

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Take the strongest cell of each full echo's padded DFT."""
        from isac_cosim.isacsim.radio.estimators import on_tensor

        return on_tensor.padded_grid(echo)

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """The bound at the estimated SNR and a uniform error over half a cell."""
        return _deviation(power, waveform, 0.5)


class PaddedParabola:
    """The strongest cell of the DFT padded twofold, refined along each axis by a parabola through its neighbours.

    The parabola is through the logarithms (Smith & Serra 1987), of which the error between cells is the smallest.
    """

    label = "grid, padded twofold, with a parabola"

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw DFT blocks of half cells, take the strongest, and refine it."""

        def estimate(part: slice) -> Estimates:
            bins = draw_bins(cells[part], snr[part], "half", waveform, rng)
            index, height = strongest(bins.values)
            place = bins.first + (index + _vertices(bins, index)) * bins.spacing
            return beaten_by_rival(Estimates(place, height), height, bins)

        return in_chunks(len(snr), estimate)

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Refine the strongest cell of each full echo's padded DFT."""
        from isac_cosim.isacsim.radio.estimators import on_tensor

        return on_tensor.padded_parabola(echo)

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """The bound at the estimated SNR, and the bias of the parabola."""
        bias = np.array([_parabola_bias(count) for count in waveform.shape])
        return np.asarray(np.sqrt(cell_bound(estimated_snr(power, waveform), waveform) ** 2 + bias**2))


def vertex(low: Array, peak: Array, high: Array) -> Array:
    """Offset of the vertex of the parabola through three even samples from the middle one, in samples, at most 1/2."""
    bend = low - 2 * peak + high
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.nan_to_num((low - high) / (2 * bend))
    return np.asarray(np.clip(offset, -0.5, 0.5))


def _vertices(bins: Bins, index: IntArray) -> Array:
    """Offset of the vertex along each axis, in bins, (B, 3)."""
    rows = np.arange(len(index))
    offset = np.empty(index.shape)
    for axis in range(3):
        # A peak at the edge of the block is noise: its inner neighbours say as much.
        middle = index.copy()
        middle[:, axis] = np.clip(index[:, axis], 1, bins.values.shape[axis + 1] - 2)
        unit = np.eye(3, dtype=np.int64)[axis]
        three = (np.abs(bins.values[(rows, *(middle + k * unit).T)]) for k in (-1, 0, 1))
        offset[:, axis] = vertex(*(np.log(np.maximum(size, 1e-300)) for size in three))
    return offset


@cache
def _parabola_bias(count: int) -> float:
    """Root mean square of the error without noise, cells, along an axis of `count`, over all places between bins."""
    place = np.linspace(-0.25, 0.25, 501)
    low, peak, high = (np.log(np.sinc(place - k / 2) / np.sinc((place - k / 2) / count)) for k in (-1, 0, 1))
    return float(np.sqrt(np.mean((vertex(low, peak, high) / 2 - place) ** 2)))


def _observe(cells: Array, snr: Array, search: Search, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    def estimate(part: slice) -> Estimates:
        bins = draw_bins(cells[part], snr[part], search, waveform, rng)
        index, height = strongest(bins.values)
        return beaten_by_rival(Estimates(bins.first + index * bins.spacing, height), height, bins)

    return in_chunks(len(snr), estimate)


def _deviation(power: Array, waveform: Waveform, width: float) -> Array:
    """Of estimates rounded to a grid of `width` cells, (B, 3)."""
    return np.asarray(np.sqrt(cell_bound(estimated_snr(power, waveform), waveform) ** 2 + width**2 / 12))
