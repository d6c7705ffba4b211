"""The cells of one panel's transformed and tapered echo, drawn where there are targets, with the law that they have.

An echo of Q scattering points has the three axes of `isacsim.radio.waveform`. After a taper and a DFT along each of
them, in units where the noise of an untapered cell has unit variance, it is

    Z[d, r, p] = sum_q sqrt(N) b_q kd(d - d_q) kr(r - r_q) kp(p - p_q) + noise
    k(x) = t0 D(x) + t1 (D(x - 1) + D(x + 1))

D is the Dirichlet kernel. Raised cosines, such as Hann's and Hamming's tapers, are sums of three neighbouring cells, so
that tapered noise is drawn as white noise on the cells and a rim around them, and summed. It has its exact law,
correlations included.

Cells are drawn in a block around every scattering point, which is as wide as all angles. Every point counts in every
cell. In the cells elsewhere only noise can exceed a threshold; `isacsim.scene.detection` draws these exceedances by
their rate. Ranges do not change during a snapshot here; `benchmarks.scene_cube`, in which they do, is the slow oracle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.radio.waveform import Waveform

HALF_RANGE, HALF_DOPPLER = 3, 2
"""Half-widths of the block of cells around a scattering point, cells: the main lobe of Hann's kernel."""
HANN, HAMMING = (0.5, 0.25), (0.54, 0.23)


@dataclass(frozen=True)
class Tapers:
    """Weights of a cell and of its two neighbours along each axis: angle, range, Doppler."""

    angle: tuple[float, float] = HAMMING
    range: tuple[float, float] = HANN
    doppler: tuple[float, float] = HANN

    @cached_property
    def noise(self) -> float:
        """Variance of the noise of a tapered cell, where that of a plain one is 1."""
        return float(np.prod([t0**2 + 2 * t1**2 for t0, t1 in (self.angle, self.range, self.doppler)]))


@dataclass(frozen=True)
class CellGrid:
    """The cells of a panel: all angles and Doppler shifts, and the ranges up to the longest one of interest.

    Angle cell k is at a sine of k - P/2 cells, Doppler cell k at k - M/2 cells of radial velocity, range cell k at k.
    """

    waveform: Waveform
    ranges: int
    tapers: Tapers = Tapers()

    @classmethod
    def of(cls, waveform: Waveform, range_m: float, tapers: Tapers | None = None) -> CellGrid:
        """Return the grid that holds ranges up to range_m, m, with room for a peak there."""
        reach = int(np.ceil(range_m * abs(waveform.cells_per_unit[1]))) + 2
        return cls(waveform, min(reach, waveform.subcarriers), tapers or Tapers())

    @cached_property
    def per_unit(self) -> Array:
        """Cells per unit of sine, per m and per m/s, all positive, (3,)."""
        return np.abs(self.waveform.cells_per_unit)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of Doppler, range and angle cells."""
        return self.waveform.symbols, self.ranges, self.waveform.antennas

    @property
    def size(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))


@dataclass(frozen=True)
class Echoes:
    """Q scattering points as a panel sees them.

    measured: sine, slant range (m), radial velocity (m/s), (Q, 3). amplitude: of an antenna element at the middle of
    the snapshot, in units of the noise, complex, (Q,).
    """

    measured: Array
    amplitude: ComplexArray


@dataclass(frozen=True)
class DrawnCells:
    """The cells that were drawn: n pairs of a Doppler and a range cell, each with all P angle cells.

    doppler, range: number of the pair's cells, (n,). values: (n, P). place: row of each pair in the arrays, -1 where
    nothing was drawn, (M, ranges).
    """

    doppler: IntArray
    range: IntArray
    values: npt.NDArray[np.complex64]
    place: npt.NDArray[np.int32]


def dirichlet(offset: Array, count: int) -> Array:
    """Return the response of a DFT cell to a tone `offset` cells away, about the axis' centre. (...) -> (...)."""
    below = count * np.sin(np.pi * offset / count)
    near = np.abs(below) < 1e-9
    value = np.sin(np.pi * offset) / np.where(near, 1.0, below)
    if near.any():
        # A whole number of turns away, the response is 1 or -1: an axis of an even number is counted from its middle.
        turns = np.rint(offset / count)
        value = np.where(near, np.where((turns * (count - 1)) % 2 == 0, 1.0, -1.0), value)
    return np.asarray(value)


def kernel(offset: Array, count: int, taper: tuple[float, float]) -> Array:
    """Return the response of a tapered cell to a tone `offset` cells away. (...) -> (...)."""
    t0, t1 = taper
    return t0 * dirichlet(offset, count) + t1 * (dirichlet(offset - 1, count) + dirichlet(offset + 1, count))


def draw(echoes: Echoes, grid: CellGrid, rng: np.random.Generator) -> DrawnCells:
    """Draw the cells around the scattering points of one panel at one instant. Points beyond the grid are left out."""
    count, ranges, _ = grid.shape
    cells = echoes.measured * grid.per_unit
    inside = cells[:, 1] < ranges
    cells, amplitude = cells[inside], echoes.amplitude[inside]
    middle = np.rint(cells).astype(np.int64)
    doppler = (middle[:, 2, None] + count // 2 + np.arange(-HALF_DOPPLER, HALF_DOPPLER + 1)) % count
    reach = middle[:, 1, None] + np.arange(-HALF_RANGE, HALF_RANGE + 1)
    # A margin of one range cell on either side keeps the rim within the array.
    wanted = np.zeros((count, ranges + 2), dtype=bool)
    wanted[doppler[:, :, None], np.clip(reach, 0, ranges - 1)[:, None, :] + 1] = True
    at_doppler, at_range = (part.astype(np.int64) for part in np.nonzero(wanted))
    rows = at_doppler, at_range
    place = np.full(wanted.shape, -1, np.int32)
    place[rows] = np.arange(len(rows[0]), dtype=np.int32)
    at_range = at_range - 1
    values = _noise(wanted, rows, grid, rng)
    values += _signal(cells, amplitude, at_doppler, at_range, grid)
    return DrawnCells(at_doppler, at_range, values, place[:, 1:-1])


def _signal(
    cells: Array, amplitude: ComplexArray, at_doppler: IntArray, at_range: IntArray, grid: CellGrid
) -> npt.NDArray[np.complex64]:
    """Return the sum of the points' responses in pairs of a Doppler and a range cell, (n, P). cells: (Q, 3)."""
    waveform, tapers = grid.waveform, grid.tapers
    count, ranges, antennas = grid.shape
    along = responses(0, ranges, cells[:, 1], waveform.subcarriers, tapers.range).T.astype(np.float32)
    # A tone beyond half the axis is seen as if it came from the other side.
    shift = responses(-(count // 2), count, cells[:, 2], count, tapers.doppler).T.astype(np.float32)
    angle = responses(-(antennas // 2), antennas, cells[:, 0], antennas, tapers.angle)
    weighted = (np.sqrt(waveform.size) * amplitude[:, None] * angle).astype(np.complex64)
    separate = np.ascontiguousarray(weighted).view(np.float32)
    both = shift.take(at_doppler, axis=0)
    both *= along.take(at_range, axis=0)
    return np.asarray((both @ separate).view(np.complex64))


def responses(first: int, cells: int, place: Array, count: int, taper: tuple[float, float]) -> Array:
    """Return the responses of so many tapered cells, from the first one on, to tones at Q places, (Q, cells).

    Equal to `kernel`, by the sine of a difference: a tone's cell is a whole number, so that its sines are known.
    """
    whole = np.rint(place).astype(np.int64)
    rest = (place - whole)[:, None]
    # Where a tone is in the middle of its cell, the response is a limit, which is equal to rounding so near to it.
    rest = np.where(np.abs(rest) < 1e-9, 1e-9, rest)
    begin = (first - 1 - whole) % (2 * count)
    sine, cosine, sign = (of[begin] for of in _turns(count, cells + 2))
    sine *= np.cos(np.pi * rest / count)
    cosine *= np.sin(np.pi * rest / count)
    sine -= cosine
    sign *= np.sin(np.pi * rest) / -count
    sign /= sine
    beside = sign[:, :-2] + sign[:, 2:]
    beside *= taper[1]
    beside += taper[0] * sign[:, 1:-1]
    return beside


@lru_cache(maxsize=8)
def _turns(count: int, length: int) -> tuple[Array, Array, Array]:
    """Return the sine and cosine of `length` whole multiples of pi / count, and the sign of pi times them.

    Each is a view, (2 count, length), by the first multiple.
    """
    whole = np.arange(2 * count + length - 1)
    sine, cosine = np.sin(np.pi * whole / count), np.cos(np.pi * whole / count)
    sine[::count] = 0.0
    sine, cosine, sign = (
        np.lib.stride_tricks.sliding_window_view(of, length) for of in (sine, cosine, np.where(whole % 2, -1.0, 1.0))
    )
    return sine, cosine, sign


def _noise(
    wanted: npt.NDArray[np.bool_], rows: tuple[IntArray, IntArray], grid: CellGrid, rng: np.random.Generator
) -> npt.NDArray[np.complex64]:
    """Return tapered noise in the wanted pairs of a Doppler and a range cell, (n, P).

    wanted: (M, ranges + 2). rows: where it is true.
    """
    count, _, antennas = grid.shape
    column = wanted | np.roll(wanted, 1, axis=0) | np.roll(wanted, -1, axis=0)
    rim = column.copy()
    rim[:, 1:] |= column[:, :-1]
    rim[:, :-1] |= column[:, 1:]
    # Real and imaginary parts side by side, because weights are real.
    white = rng.standard_normal((int(rim.sum()), 2 * antennas), np.float32)
    number = np.zeros(wanted.shape, np.int64)
    number[rim] = np.arange(len(white))
    t0, t1 = map(np.float32, grid.tapers.range)
    # Cells of one Doppler shift follow one another, so that neighbours along the range are the rows beside a column.
    middle = number[column]
    beside = white.take(middle - 1, axis=0)
    beside += white.take(middle + 1, axis=0)
    beside *= t1
    tapered = white.take(middle, axis=0)
    tapered *= t0
    tapered += beside
    number[column] = np.arange(len(tapered))
    t0, t1 = map(np.float32, grid.tapers.doppler)
    doppler, at_range = rows
    total = tapered.take(number[rows], axis=0)
    total *= t0
    for step in (-1, 1):
        neighbour = doppler + step
        beside = tapered.take(number[neighbour % count, at_range], axis=0)
        beside *= t1
        if count % 2 == 0:
            beside[(neighbour < 0) | (neighbour >= count)] *= np.float32(-1.0)
        total += beside
    t0, t1 = (np.float32(np.sqrt(0.5) * weight) for weight in grid.tapers.angle)
    beside = t1 * total
    total *= t0
    total[:, 2:] += beside[:, :-2]
    total[:, :-2] += beside[:, 2:]
    turn = np.float32(-1.0 if antennas % 2 == 0 else 1.0)
    total[:, :2] += turn * beside[:, -2:]
    total[:, -2:] += turn * beside[:, :2]
    return np.asarray(total.view(np.complex64))
