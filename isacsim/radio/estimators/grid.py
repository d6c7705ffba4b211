"""Grid estimators: the strongest cell of the DFT, plain or padded, and nothing finer (the paper's method)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo import Search, draw_bins
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


def _observe(cells: Array, snr: Array, search: Search, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    def estimate(part: slice) -> Estimates:
        bins = draw_bins(cells[part], snr[part], search, waveform, rng)
        index, height = strongest(bins.values)
        return beaten_by_rival(Estimates(bins.first + index * bins.spacing, height), height, bins)

    return in_chunks(len(snr), estimate)


def _deviation(power: Array, waveform: Waveform, width: float) -> Array:
    """Of estimates rounded to a grid of `width` cells, (B, 3)."""
    return np.asarray(np.sqrt(cell_bound(estimated_snr(power, waveform), waveform) ** 2 + width**2 / 12))
