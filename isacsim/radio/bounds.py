"""Cramer-Rao bounds of what one echo measures; those of a position are in `isacsim.tracking.fusion`.

A single target of unknown complex amplitude in white noise, rho = |b|^2 / sigma^2 the per-element SNR and N
the number of elements. Source: Rife & Boorstyn, IEEE Trans. Inf. Theory 20 (1974), for the model of Eq. (1) of ASI-BIP.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.radio.waveform import Waveform


def cell_bound(snr: Array, waveform: Waveform) -> Array:
    """Bound of the frequency along each axis, whose variance is 6 / (rho N (Ni^2 - 1)) in radians per element.

    snr: per-element SNR, linear, shape (...). Returns the standard deviation in cells, shape (..., 3).
    """
    counts = np.array(waveform.shape, dtype=np.float64)
    # Each axis in one piece of memory, as in `Panels.measured`.
    variance = np.multiply.outer(counts**2 - 1, np.asarray(snr) * waveform.size)
    radians = np.moveaxis(np.sqrt(6 / variance), 0, -1)
    return np.asarray(radians * counts / (2 * np.pi))


def measured_bound(snr: Array, waveform: Waveform) -> Array:
    """Bound of sine of the angle, range (m) and radial velocity (m/s).

    snr: per-element, linear, shape (...). Returns standard deviations, shape (..., 3).
    """
    return np.asarray(cell_bound(snr, waveform) / np.abs(waveform.cells_per_unit))
