"""The slow oracles of `isacsim.scene.cells`: all cells of a panel's echo, from the echo itself.

`cube` adds up the points symbol by symbol, where each of them is by then, so that ranges and angles migrate. `tensor`
is the whole echo in the model of `isacsim.radio.waveform`, element by element, for small numerologies.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray
from isac_cosim.isacsim.radio.echo import white
from isac_cosim.isacsim.radio.waveform import centred, steering
from isac_cosim.isacsim.scene.cells import CellGrid, DrawnCells, Echoes, dirichlet


def cube(offset: Array, velocity: Array, right: Array, amplitude: ComplexArray, grid: CellGrid,
         rng: np.random.Generator) -> DrawnCells:  # fmt: skip
    """Draw all cells of one panel, from points that move on during the snapshot.

    offset: of the points from the panel at the middle of the snapshot, x, y, z, m, (Q, 3). velocity: x, y, m/s, (Q, 2).
    right: unit vector along the array, (2,). amplitude: (Q,), as in `Echoes`; its phase is that at the middle.
    """
    waveform = grid.waveform
    count, ranges, antennas = grid.shape
    time_s = centred(count) * waveform.symbol_s
    ground = offset[:, None, :2] + velocity[:, None] * time_s[:, None]
    distance = np.sqrt((ground**2).sum(axis=-1) + offset[:, 2:] ** 2)
    start = np.sqrt((offset**2).sum(axis=1))[:, None]
    turned = amplitude[:, None] * np.exp(4j * np.pi / waveform.wavelength_m * (distance - start))
    sine = (ground @ right) / distance
    sine_cells, range_cells = sine * grid.per_unit[0], distance * grid.per_unit[1]
    angle = dirichlet(np.arange(antennas) - antennas // 2 - sine_cells[..., None], antennas)
    along = dirichlet(np.arange(ranges) - range_cells[..., None], waveform.subcarriers)
    each = np.sqrt(waveform.subcarriers * antennas) * turned[..., None] * angle
    symbols = np.einsum("qmp,qmr->mrp", each, along, optimize=True) + white((count, ranges, antennas), rng)
    return _tapered(_over_symbols(symbols), grid)


def tensor(echoes: Echoes, grid: CellGrid, rng: np.random.Generator) -> DrawnCells:
    """Draw a whole echo, and transform it."""
    waveform = grid.waveform
    cells = echoes.measured * grid.per_unit
    phasors = [steering(cells[:, axis], n) for axis, n in enumerate(waveform.shape)]
    echo = np.einsum("q,qp,qn,qm->pnm", echoes.amplitude, *phasors, optimize=True) + white(waveform.shape, rng)
    axes = []
    for n, first in zip(waveform.shape, (-(waveform.antennas // 2), 0, -(waveform.symbols // 2)), strict=True):
        axes.append(np.conj(steering(first + np.arange(n, dtype=np.float64), n)) / np.sqrt(n))
    values = np.einsum("pnm,ap,rn,dm->dra", echo, *axes, optimize=True)
    return _tapered(values[:, : grid.ranges], grid)


def _over_symbols(values: ComplexArray) -> ComplexArray:
    """Return Doppler cells from symbols, along the first axis."""
    count = len(values)
    cells = np.arange(count, dtype=np.float64) - count // 2
    return np.asarray(np.tensordot(np.conj(steering(cells, count)) / np.sqrt(count), values, axes=1))


def _tapered(values: ComplexArray, grid: CellGrid) -> DrawnCells:
    """Return all cells with tapers. values: (M, ranges, P); the outermost ranges have a neighbour on one side only."""
    for axis, (t0, t1) in enumerate((grid.tapers.doppler, grid.tapers.range, grid.tapers.angle)):
        total = t0 * values
        count = values.shape[axis]
        for step in (1, -1):
            beside = np.roll(values, step, axis=axis)
            edge: list[slice | int] = [slice(None)] * 3
            edge[axis] = 0 if step == 1 else count - 1
            # Half-way round an even axis, cells counted from its middle change their sign; ranges do not come round.
            beside[tuple(edge)] *= 0.0 if axis == 1 else (-1.0 if count % 2 == 0 else 1.0)
            total = total + t1 * beside
        values = total
    count, ranges, antennas = grid.shape
    doppler, at_range = (part.ravel() for part in np.indices((count, ranges)))
    place = np.arange(count * ranges, dtype=np.int32).reshape(count, ranges)
    return DrawnCells(doppler, at_range, values.reshape(-1, antennas).astype(np.complex64), place)
