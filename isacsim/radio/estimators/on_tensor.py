"""The estimators on full echo tensors, in torch: nothing here knows where the target is."""

from __future__ import annotations

from itertools import product

import numpy as np
import torch

from isac_cosim.isacsim.radio.echo_tensor import steering
from isac_cosim.isacsim.radio.estimation import SCORING_STEPS
from isac_cosim.isacsim.radio.waveform import centred

Found = tuple[torch.Tensor, torch.Tensor]
"""Cells (B, 3) and power (B,) of the strongest target of each echo, float64."""


def maximum_likelihood(echo: torch.Tensor) -> Found:
    """Search cells and half cells, then score; echo: (B, antennas, subcarriers, symbols), as of all below."""
    return score(echo, strongest_pairs(transform(echo)))


def grid(echo: torch.Tensor) -> Found:
    """Take the strongest cell of the transform."""
    index, power = _strongest(transform(echo))
    return _around_zero(index.double(), echo.shape[1:]), power


def padded_grid(echo: torch.Tensor) -> Found:
    """Take the strongest cell of the transform padded twofold along each axis."""
    counts = echo.shape[1:]
    bins = torch.fft.fftn(echo, s=[2 * count for count in counts], dim=(1, 2, 3))
    index, power = _strongest(bins)
    return _around_zero(index.double() / 2, counts), power / echo[0].numel()


def padded_parabola(echo: torch.Tensor) -> Found:
    """Refine the strongest cell of the padded transform by a parabola through it and its neighbours, on each axis."""
    counts = echo.shape[1:]
    bins = torch.fft.fftn(echo, s=[2 * count for count in counts], dim=(1, 2, 3))
    index, power = _strongest(bins)
    rows, sizes = torch.arange(len(bins), device=bins.device), torch.tensor(bins.shape[1:], device=bins.device)
    offset = torch.empty(index.shape, dtype=torch.float64, device=bins.device)
    for axis in range(3):
        unit = torch.zeros(3, dtype=index.dtype, device=bins.device)
        unit[axis] = 1
        low, peak, high = (bins[(rows, *((index + k * unit) % sizes).T)].abs().double().log() for k in (-1, 0, 1))
        offset[:, axis] = ((low - high) / (2 * (low - 2 * peak + high))).clamp(-0.5, 0.5)
    return _around_zero(index.double() / 2, counts) + offset / 2, power / echo[0].numel()


def candan(echo: torch.Tensor) -> Found:
    """Refine the strongest cell by its neighbours, and its power by the share that the cell kept."""
    bins = transform(echo)
    index, power = _strongest(bins)
    offset = _candan_offset(bins, index)
    counts = torch.tensor(echo.shape[1:], device=echo.device)
    power = power / (offset.sinc() / (offset / counts).sinc()).square().prod(dim=1)
    return _around_zero(index.double(), echo.shape[1:]) + offset, power


def transform(echo: torch.Tensor) -> torch.Tensor:
    """Unitary DFT, phases about the centre of each axis: a target between two cells has the same sign in both."""
    bins: torch.Tensor = torch.fft.fftn(echo, dim=(1, 2, 3), norm="ortho")
    for axis, count in enumerate(echo.shape[1:]):
        turn = torch.exp(1j * torch.pi * (count - 1) / count * torch.arange(count, device=echo.device))
        bins *= turn.to(echo.dtype).reshape([-1 if k == axis else 1 for k in range(3)])
    return bins


def score(echo: torch.Tensor, place: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Fisher scoring of the likelihood from `place` (B, 3) on: d(omega) = Im(s'/s) 12 / (N^2 - 1) along each axis.

    s is the matched filter and s' the one weighted by the element number about the centre.
    """
    counts = echo.shape[1:]
    place = place.clone()
    power = torch.zeros(len(echo), dtype=torch.float64, device=echo.device)
    for step in range(SCORING_STEPS + 1):
        filters = [_filters(place[:, axis], count, echo.dtype) for axis, count in enumerate(counts)]
        # (B, value or slope) along each axis: contracted from the last axis to the first.
        partial = torch.einsum("nijk,nck->nijc", echo, filters[2])
        partial = torch.einsum("nijc,nbj->nibc", partial, filters[1])
        matched = torch.einsum("nibc,nai->nabc", partial, filters[0]).to(torch.complex128)
        value = matched[:, 0, 0, 0]
        power = value.abs().square() / echo[0].numel()
        if step == SCORING_STEPS:
            break
        for axis, slope in enumerate((matched[:, 1, 0, 0], matched[:, 0, 1, 0], matched[:, 0, 0, 1])):
            count = counts[axis]
            radians = (slope / value).imag * 12 / (count**2 - 1)
            place[:, axis] += (radians * count / (2 * torch.pi)).clamp(-0.5, 0.5)
    return place, power


def _filters(place: torch.Tensor, count: int, dtype: torch.dtype) -> torch.Tensor:
    """Conjugate steering vector, plain and weighted by the centred element number, (B, 2, count)."""
    plain = steering(place, count).conj()
    weighted = plain * torch.as_tensor(centred(count), device=place.device)
    return torch.stack([plain, weighted], dim=1).to(dtype)


def strongest_pairs(bins: torch.Tensor) -> torch.Tensor:
    """Place of the strongest of the cells and half cells, (B, 3): see `maximum_likelihood.strongest_pairs`."""
    best = torch.zeros(len(bins), dtype=torch.float64, device=bins.device)
    place = torch.zeros((len(bins), 3), dtype=torch.float64, device=bins.device)
    for half in product((0, 1), repeat=3):
        values = bins
        for axis in (k for k in range(3) if half[k]):
            values = (values + _next_cell(values, axis)) * 0.5**0.5
        index, power = _strongest(values)
        better = power > best
        best = torch.where(better, power, best)
        offset = torch.tensor(half, device=bins.device) / 2
        place = torch.where(better[:, None], _around_zero(index.double(), bins.shape[1:]) + offset, place)
    return place


def _next_cell(values: torch.Tensor, axis: int) -> torch.Tensor:
    """Each cell's upper neighbour; counted about the centre of an even axis, the phase turns sign after one round."""
    rolled = torch.roll(values, -1, dims=axis + 1)
    count = values.shape[axis + 1]
    if count % 2 == 0:
        rolled.select(axis + 1, count - 1).neg_()
    return rolled


def _strongest(values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    power = values.real.square() + values.imag.square()
    height, flat = power.flatten(1).max(dim=1)
    index = torch.stack(torch.unravel_index(flat, values.shape[1:]), dim=1)
    return index, height.double()


def _around_zero(index: torch.Tensor, counts: torch.Size) -> torch.Tensor:
    """Cells in the coordinates of `Waveform.measured`: angle and Doppler about zero, delay below it."""
    turns = torch.tensor(list(counts), dtype=torch.float64, device=index.device)
    wrapped = torch.where(index >= turns / 2, index - turns, index)
    wrapped[:, 1] = torch.where(index[:, 1] > 0, index[:, 1] - turns[1], index[:, 1])
    return wrapped


def _candan_offset(bins: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """Candan's offset along each axis, cells, (B, 3): see `isacsim.radio.estimators.candan`."""
    rows = torch.arange(len(bins), device=bins.device)
    offset = torch.empty(index.shape, dtype=torch.float64, device=bins.device)
    for axis, count in enumerate(bins.shape[1:]):
        phase = torch.exp(-1j * torch.pi * (count - 1) / count * torch.arange(count, device=bins.device)).to(bins.dtype)
        plain = bins * phase.reshape([-1 if k == axis else 1 for k in range(3)])
        unit = torch.zeros(3, dtype=index.dtype, device=bins.device)
        unit[axis] = 1
        low, peak, high = (
            plain[(rows, *((index + k * unit) % torch.tensor(bins.shape[1:], device=bins.device)).T)]
            for k in (-1, 0, 1)
        )
        ratio = ((low - high) / (2 * peak - low - high)).real.double()
        tangent = float(np.tan(np.pi / count))
        offset[:, axis] = count / torch.pi * torch.arctan(tangent * ratio)
    return offset.clamp(-0.7, 0.7)
