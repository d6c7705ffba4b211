"""What an estimator of angle, delay and Doppler must do, and what the implementations share.

Everything is in cells (see `isacsim.radio.waveform`). The implementations are in `isacsim.radio.estimators`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.radio.echo import Bins
from isac_cosim.isacsim.radio.waveform import Waveform

if TYPE_CHECKING:
    import torch

SCORING_STEPS = 4
"""Steps of Fisher scoring, on DFT blocks and on full echoes alike."""
_CHUNK = 1024
"""Echoes whose DFT blocks are drawn at once, which bounds the memory."""


@dataclass(frozen=True)
class Estimates:
    """Estimates from B echoes.

    cells: estimated coordinates, (B, 3). power: of the estimated target after coherent processing, in units of the
    noise, (B,).
    """

    cells: Array
    power: Array


class Estimator(Protocol):
    """A way of estimating a target's angle, delay and Doppler from its echo.

    label: a few words for figures and help texts.

    `observe` draws DFT blocks (`isacsim.radio.echo`) and is fast; `estimate` works on full echo tensors, of which it
    knows nothing else, and is the oracle of `observe`: estimates of both must follow one law.
    """

    label: str

    def observe(self, cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> Estimates:
        """Draw the DFT block of one echo for each target and estimate from it.

        cells: true coordinates, (B, 3). snr: per-element, linear, (B,).
        """

    def estimate(self, echo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Estimate the strongest target of each full echo.

        echo: with noise of unit variance, (B, antennas, subcarriers, symbols), complex. torch is to be imported here,
        so that whoever draws DFT blocks need not load it. Returns cells (B, 3) and power (B,), float64.
        """

    def deviation(self, power: Array, waveform: Waveform) -> Array:
        """Standard deviation that the receiver assumes for its estimates, cells, (B, 3). power: estimated, (B,)."""


def estimated_snr(power: Array, waveform: Waveform) -> Array:
    """Per-element SNR that an estimated power (B,) stands for, linear, (B,).

    The maximum over amplitude, phase and three frequencies exceeds the target's own power by 2.5 on average.
    """
    return np.asarray(np.maximum(power - 2.5, 0.5) / waveform.size)


def in_chunks(count: int, estimate: Callable[[slice], Estimates]) -> Estimates:
    """Estimate from `count` echoes, some at a time. estimate: gives the estimates of a slice of them."""
    parts = [estimate(slice(begin, min(begin + _CHUNK, count))) for begin in range(0, count, _CHUNK)]
    return Estimates(np.concatenate([part.cells for part in parts]), np.concatenate([part.power for part in parts]))


def strongest(values: ComplexArray) -> tuple[IntArray, Array]:
    """Index (B, 3) and power (B,) of the strongest of the values of each block (B, a, b, c)."""
    power = (values.real**2 + values.imag**2).reshape(len(values), -1)
    flat = power.argmax(axis=1)
    index = np.stack(np.unravel_index(flat, values.shape[1:]), axis=1)
    return index, power[np.arange(len(values)), flat]


def beaten_by_rival(estimates: Estimates, height: Array, bins: Bins) -> Estimates:
    """Replace estimates by the rival where it is stronger than the peak of the drawn cells, `height`, (B,)."""
    lost = bins.rival.power > height
    return Estimates(
        np.where(lost[:, None], bins.rival.cells, estimates.cells), np.where(lost, bins.rival.power, estimates.power)
    )
