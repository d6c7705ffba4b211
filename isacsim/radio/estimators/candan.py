"""Candan's estimator: the peak cell of the DFT and its two neighbours along each axis.

Source: Candan, IEEE Signal Process. Lett. 18 (2011), with the arctangent of the 2013 refinement.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo import Bins, draw_bins
from isac_cosim.isacsim.radio.estimation import Estimates, beaten_by_rival, estimated_snr, in_chunks, strongest
from isac_cosim.isacsim.radio.waveform import Waveform

if TYPE_CHECKING:
    import torch

OVER_BOUND = 2.15
"""Its standard deviation over the Cramer-Rao bound, anywhere between cells."""


class Candan:
    """The peak cell, refined by its neighbours."""

    label = "Candan"

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw DFT blocks and estimate from them."""
        return in_chunks(len(snr), lambda part: _observe(cells[part], snr[part], waveform, rng))

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Refine the peak of each full echo's DFT."""
        from isac_cosim.isacsim.radio.estimators import on_tensor

        return on_tensor.candan(echo)

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """OVER_BOUND times the Cramer-Rao bound at the estimated SNR."""
        return OVER_BOUND * cell_bound(estimated_snr(power, waveform), waveform)


def _observe(cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
    bins = draw_bins(cells, snr, "whole", waveform, rng)
    index, height = strongest(bins.values)
    offset = _offsets(bins, index, waveform)
    place = bins.first + index * bins.spacing
    return beaten_by_rival(Estimates(place + offset, height / _kept(offset, waveform)), height, bins)


def _offsets(bins: Bins, index: IntArray, waveform: Waveform) -> Array:
    """Offset from the peak cell along each axis, cells, (B, 3)."""
    rows = np.arange(len(index))
    offset = np.empty(index.shape)
    for axis, count in enumerate(waveform.shape):
        # A peak at the edge of the block is noise, and so is what its inner neighbours say of it.
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
    """Offset in cells from three neighbouring cells (B,) of an axis of `count`, phases about the centre, (B,)."""
    turn = np.exp(1j * np.pi / count)
    # Counted from the first element, neighbouring cells alternate in sign and turn by half an element's phase.
    low, high = -low / turn, -high * turn
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(((low - high) / (2 * peak - low - high)).real)
    offset = count / np.pi * np.arctan(np.tan(np.pi / count) * ratio)
    return np.asarray(np.clip(offset, -0.7, 0.7))
