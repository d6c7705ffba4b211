"""OFDM numerology and the separable phase model of one echo (Eq. 1-2 of ASI-BIP).

An echo has three axes: antennas, subcarriers, symbols. Along each axis the phase advances by a constant from element to
element. This module counts that frequency in **cells** of the axis' DFT (on an axis of N elements, N cells are one turn
per element), so that a target is a point of three cell coordinates: angle, delay, Doppler.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field

from isac_cosim.base.arrays import Array
from isac_cosim.base.settings import Settings

LIGHT_SPEED_MPS = 299_792_458.0


class Waveform(Settings):
    """The sensing waveform and the receiving array. The defaults are those of Section IV-A of ASI-BIP."""

    carrier_hz: float = Field(3.5e9, gt=0, le=1e13, description="Carrier frequency.")
    subcarrier_spacing_hz: float = Field(30e3, gt=0, le=1e9, description="Subcarrier spacing.")
    symbol_s: float = Field(
        0.5e-3 / 14,
        gt=0,
        le=1,
        description="OFDM symbol with its cyclic prefix (3GPP TS 38.211: 14 in a slot of 0.5 ms).",
    )
    cyclic_prefix_s: float | None = Field(
        144 / 61.44e6,
        gt=0,
        le=1,
        description="Cyclic prefix of a symbol, which limits the longest range (3GPP TS 38.211, 5.3.1: 144 samples at "
        "61.44 MHz, the normal prefix at 30 kHz; the first symbol of a slot has more). Absent: no limit.",
    )
    subcarriers: int = Field(128, ge=4, le=65_536, description="Subcarriers used for sensing.")
    symbols: int = Field(42, ge=4, le=65_536, description="OFDM symbols of one snapshot.")
    antennas: int = Field(8, ge=4, le=1024, description="Antennas of the linear receiving array.")
    spacing_wavelengths: float = Field(0.5, gt=0, le=0.5, description="Antenna spacing over the wavelength.")

    @property
    def wavelength_m(self) -> float:
        """Carrier wavelength, m."""
        return LIGHT_SPEED_MPS / self.carrier_hz

    @property
    def longest_range_m(self) -> float:
        """Range whose echo is delayed by the whole cyclic prefix: beyond it, symbols run into each other, m.

        >>> round(Waveform().longest_range_m, 1)
        351.3
        """
        return LIGHT_SPEED_MPS * self.cyclic_prefix_s / 2 if self.cyclic_prefix_s is not None else float("inf")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Antennas, subcarriers, symbols: the shape of one echo."""
        return self.antennas, self.subcarriers, self.symbols

    @property
    def size(self) -> int:
        """Number of elements of one echo, which is the gain of coherent processing."""
        return self.antennas * self.subcarriers * self.symbols

    @property
    def cells_per_unit(self) -> Array:
        """Cells per unit of sine of the angle, per metre of range and per m/s of radial velocity, shape (3,).

        Delay turns the phase backwards, and so does a growing range (Doppler shift -2 v f / c): both are negative.
        """
        return np.array(
            [
                self.antennas * self.spacing_wavelengths,
                -self.subcarriers * self.subcarrier_spacing_hz * 2 / LIGHT_SPEED_MPS,
                -self.symbols * self.symbol_s * 2 * self.carrier_hz / LIGHT_SPEED_MPS,
            ]
        )

    def cells(self, measured: Array) -> Array:
        """Cell coordinates of (sine of angle, range in m, radial velocity in m/s), shape (..., 3) -> (..., 3)."""
        return np.asarray(measured * self.cells_per_unit)

    def measured(self, cells: Array) -> Array:
        """Sine of the angle, range (m), radial velocity (m/s) at cell coordinates, shape (..., 3) -> (..., 3).

        Coordinates are taken modulo the axis: sine and velocity around zero, range from zero up to the ambiguity.
        """
        turns = np.array(self.shape, dtype=np.float64)
        # The angle repeats after the whole axis even where the spacing leaves part of it invisible.
        wrapped = cells - turns * np.floor(cells / turns + 0.5)
        wrapped[..., 1] = -np.mod(-cells[..., 1], turns[1])
        return np.asarray(wrapped / self.cells_per_unit)


def steering(cells: Array, count: int) -> npt.NDArray[np.complex128]:
    """Phase progression along one axis of `count` elements, Eq. (2), about the axis' centre.

    cells: frequency in cells, shape (...). Returns unit phasors, shape (..., count). Taking the phase at the centre of
    the axis rather than at its first element only turns the unknown amplitude b, and makes every kernel real.
    """
    return np.asarray(np.exp(2j * np.pi / count * np.multiply.outer(cells, centred(count))))


def centred(count: int) -> Array:
    """Element numbers about the axis' centre, shape (count,)."""
    return np.asarray(np.arange(count) - (count - 1) / 2, dtype=np.float64)
