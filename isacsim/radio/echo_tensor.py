"""The full echo tensor, in torch: the oracle of the DFT block, and work for a GPU.

Every number of every echo is drawn, and estimators work on it without knowing where the target is.
"""

from __future__ import annotations

import numpy as np
import torch

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.radio.estimation import Estimates, Estimator
from isac_cosim.isacsim.radio.waveform import Waveform, centred

BATCH = 16
"""Echoes at once on a CPU: larger batches are slower, since the allocator returns and refetches their pages."""


def observe_tensor(
    cells: Array,
    snr: Array,
    estimator: Estimator,
    waveform: Waveform,
    seed: int,
    device: str = "cpu",
    dtype: torch.dtype = torch.complex64,
    batch: int = BATCH,
) -> Estimates:
    """Draw one full echo for each target and estimate from it; the counterpart of `Estimator.observe`.

    cells: true coordinates, (B, 3). snr: per-element, linear, (B,). device: where torch works. batch: echoes at once.
    """
    generator = torch.Generator(device).manual_seed(seed)
    estimated, power = np.empty((len(snr), 3)), np.empty(len(snr))
    for begin in range(0, len(snr), batch):
        part = slice(begin, begin + batch)
        echo = synthesise(
            torch.as_tensor(cells[part], device=device),
            torch.as_tensor(snr[part], device=device),
            waveform,
            generator,
            dtype,
        )
        place, height = estimator.estimate(echo)
        estimated[part], power[part] = place.cpu().numpy(), height.cpu().numpy()
    return Estimates(estimated, power)


def synthesise(
    cells: torch.Tensor, snr: torch.Tensor, waveform: Waveform, generator: torch.Generator, dtype: torch.dtype
) -> torch.Tensor:
    """Draw echoes of Eq. (1), with unit noise and an amplitude of random phase, (B, antennas, subcarriers, symbols).

    cells: (B, 3). snr: per-element, linear, (B,).
    """
    phase = 2 * torch.pi * torch.rand(len(snr), generator=generator, device=cells.device, dtype=torch.float64)
    axes = [steering(cells[:, axis], count).to(dtype) for axis, count in enumerate(waveform.shape)]
    axes[0] = axes[0] * torch.polar(snr.double().sqrt(), phase).to(dtype)[:, None]
    echo = torch.randn((len(snr), *waveform.shape), generator=generator, device=cells.device, dtype=dtype)
    slow = axes[0][:, :, None] * axes[1][:, None, :]
    echo.addcmul_(slow[..., None], axes[2][:, None, None, :])
    return echo


def steering(place: torch.Tensor, count: int) -> torch.Tensor:
    """Phase progression along an axis of `count` elements about its centre, (B, count). place: in cells, (B,)."""
    element = torch.as_tensor(centred(count), device=place.device)
    angle = 2 * torch.pi / count * place.double()[:, None] * element
    return torch.polar(torch.ones_like(angle), angle)
