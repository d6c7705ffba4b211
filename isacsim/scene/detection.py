"""Detections of one panel in one snapshot: the peaks that stand above the noise and above other peaks' sidelobes.

A peak is a cell that is stronger than its 26 neighbours. Its place between cells follows along each axis from the ratio
of its two neighbours' magnitudes, which is known for a lone point. Two points in one cell are one detection, which lies
between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scene.cells import CellGrid, DrawnCells, Echoes, Tapers, kernel

MARGIN_DB = 10.0
"""A peak counts if it stands so far above the sum of the stronger peaks' sidelobes, dB."""
SIDELOBE_FLOOR_DB = -75.0
"""Lowest level that sidelobes are taken for, dB below their peak."""
REACH = 0.6
"""Farthest place of a peak from its cell's middle, cells."""
_NEIGHBOURS = sorted((step for step in product((-1, 0, 1), repeat=3) if any(step)), key=lambda step: np.abs(step).sum())
"""Steps to the cells around a cell, the nearest first, which rule out most."""


@dataclass(frozen=True)
class Detections:
    """What a panel found in one snapshot.

    measured: sine, slant range (m), radial velocity (m/s), (D, 3); the velocity is known up to whole ambiguities.
    deviation: standard deviation of each by the noise alone, (D, 3). power: over the noise after processing, linear,
    (D,).
    """

    measured: Array
    deviation: Array
    power: Array

    def __len__(self) -> int:
        return len(self.power)

    def places(self, panels: Panels, panel: int) -> Array:
        """Return where the detections of a panel lie in the scenario's plane, m, (D, 2); NaN where nowhere on it."""
        beside, distance = self.measured[:, 0] * self.measured[:, 1], self.measured[:, 1]
        squared = distance**2 - panels.height_m[panel] ** 2 - beside**2
        ahead = np.sqrt(np.where(squared > 0, squared, np.nan))
        place = np.array([panels.x[panel], panels.y[panel]])
        return np.asarray(place + np.outer(beside, panels.right[panel]) + np.outer(ahead, panels.front[panel]))


@dataclass(frozen=True)
class KnownPeaks:
    """Peaks of what is no vehicle. place: Doppler, range and angle cell, (K, 3). power: over the noise, (K,)."""

    place: IntArray
    power: Array

    @classmethod
    def of(cls, echoes: Echoes, grid: CellGrid) -> KnownPeaks:
        """Return the peaks of scattering points, as strong as they are on average."""
        count, _, antennas = grid.shape
        cells = np.rint(echoes.measured * grid.per_unit).astype(np.int64) + np.array([antennas // 2, 0, count // 2])
        weights = (grid.tapers.angle, grid.tapers.range, grid.tapers.doppler)
        gain = float(np.prod([t0**2 for t0, _ in weights])) / grid.tapers.noise
        return cls(cells[:, ::-1], np.abs(echoes.amplitude) ** 2 * grid.waveform.size * gain)


@dataclass(frozen=True)
class _Axis:
    """One axis of a lone point's peak. count: cells.

    log_ratio: of the upper to the lower neighbour's magnitude, against `place`, cells. slope: cells per unit of it.
    correlation: of the two neighbours' noise. sidelobe: highest power so many cells off the peak, whose own is 1,
    (count,).
    """

    count: int
    place: Array
    log_ratio: Array
    slope: Array
    correlation: float
    sidelobe: Array


def threshold(grid: CellGrid, false_alarm: float) -> float:
    """Return the power over the noise above which a peak counts, so that noise alone has one with that probability."""
    return float(np.log(grid.size / false_alarm))


def detect(
    drawn: DrawnCells,
    grid: CellGrid,
    false_alarm: float,
    rng: np.random.Generator,
    known: KnownPeaks | None = None,
) -> Detections:
    """Find the peaks in the cells that were drawn, and draw those of noise alone in the others.

    known: peaks that count no more than their sidelobes do.
    """
    level = threshold(grid, false_alarm)
    place, power = _peaks(drawn, grid, level)
    order = np.argsort(-power, kind="stable")
    place, power = place[order], power[order]
    kept = _above_sidelobes(place, power, grid, known)
    place, power = place[kept], power[kept]
    cells, deviation = _between_cells(drawn, place, grid)
    elsewhere = 1.0 - len(drawn.doppler) / (grid.shape[0] * grid.shape[1])
    stray = int(rng.poisson(false_alarm * elsewhere))
    if stray:
        at = rng.random((stray, 3)) * np.array(grid.shape)
        cells = np.concatenate([cells, at[:, ::-1]])
        power = np.concatenate([power, level + rng.standard_exponential(stray)])
        deviation = np.concatenate([deviation, np.full((stray, 3), 0.3)])
    count, _, antennas = grid.shape
    measured = (cells - np.array([antennas // 2, 0, count // 2])) / grid.per_unit
    visible = np.abs(measured[:, 0]) < 1.0
    return Detections(measured[visible], (deviation / grid.per_unit)[visible], power[visible])


def _peaks(drawn: DrawnCells, grid: CellGrid, level: float) -> tuple[IntArray, Array]:
    """Return the peaks above a level: Doppler, range and angle cell, (K, 3), and power over the noise, (K,)."""
    count, ranges, antennas = grid.shape
    # An angle's cells follow one another: comparisons of long rows are quick.
    power = np.ascontiguousarray(_power(drawn.values).T)
    power /= np.float32(grid.tapers.noise)
    # Most cells are weaker than a neighbour along the angle or the range, which are at hand.
    highest = power > level
    rises, falls = power[1:] > power[:-1], power[1:] < power[:-1]
    highest[:-1] &= ~rises
    highest[1:] &= ~falls
    highest[0] &= power[0] >= power[-1]
    highest[-1] &= power[-1] >= power[0]
    beside = (drawn.doppler[1:] == drawn.doppler[:-1]) & (drawn.range[1:] == drawn.range[:-1] + 1)
    rises, falls = power[:, 1:] > power[:, :-1], power[:, 1:] < power[:, :-1]
    highest[:, :-1] &= ~(rises & beside)
    highest[:, 1:] &= ~(falls & beside)
    angle, row = np.nonzero(highest)
    here = power[angle, row]
    place = np.stack([drawn.doppler[row], drawn.range[row], angle], axis=1)
    highest = (place[:, 1] > 0) & (place[:, 1] < ranges - 1)
    # Of the others, the neighbours along the Doppler shift rule out most.
    along, around = _steps()
    for steps in (along[:, 0], around):
        place, here = place[highest], here[highest]
        near = place[:, None] + steps
        other = drawn.place[near[..., 0] % count, near[..., 1]]
        lower = (other < 0) | (here[:, None] >= power[near[..., 2] % antennas, other])
        highest = np.asarray(lower.all(axis=1))
    return place[highest], here[highest].astype(np.float64)


def _above_sidelobes(place: IntArray, power: Array, grid: CellGrid, known: KnownPeaks | None) -> BoolArray:
    """Return which peaks, strongest first, stand above the sidelobes of the stronger ones and of those known, (K,)."""
    kept = np.zeros(len(place), dtype=bool)
    if not len(place):
        return kept
    reached = _reached(place, place, power, grid)
    covered = np.zeros(len(place)) if known is None else _reached(place, known.place, known.power, grid).sum(axis=1)
    margin = 10 ** (MARGIN_DB / 10)
    for number in range(len(place)):
        if power[number] >= margin * covered[number]:
            kept[number] = True
            covered += reached[:, number]
    return kept


def _reached(place: IntArray, peak: IntArray, power: Array, grid: CellGrid) -> Array:
    """Return the power that peaks have in places at most, (K, N). place: (K, 3). peak, power: of N, (N, 3), (N,)."""
    level = np.ones((len(place), len(peak)))
    for axis, of in enumerate(_axes(grid)):
        apart = np.abs(place[:, None, axis] - peak[:, axis])
        if axis != 1:
            apart = np.minimum(apart, of.count - apart)
        level *= of.sidelobe[apart]
    return np.asarray(power * np.maximum(level, 10 ** (SIDELOBE_FLOOR_DB / 10)))


def _between_cells(drawn: DrawnCells, place: IntArray, grid: CellGrid) -> tuple[Array, Array]:
    """Return where peaks are, in cells of angle, range and Doppler, and the deviation by noise, cells, both (K, 3)."""
    near = place[:, None, None] + _steps()[0]
    row = drawn.place[near[..., 0] % grid.shape[0], near[..., 1]]
    value = np.where(row >= 0, _power(drawn.values[row, near[..., 2] % grid.shape[2]]), 0.0)
    power = np.maximum(value.astype(np.float64) / grid.tapers.noise, 1e-3)
    low, high = power[:, 0], power[:, 1]
    log_ratio = np.log(high / low) / 2
    axes = _axes(grid)
    offset, slope = (
        np.stack([np.interp(log_ratio[:, k], of.log_ratio, getattr(of, name)) for k, of in enumerate(axes)], axis=1)
        for name in ("place", "slope")
    )
    correlation = np.array([of.correlation for of in axes])
    spread = (1 / low + 1 / high - 2 * correlation / np.sqrt(low * high)) / 2
    cells = place + np.clip(offset, -REACH, REACH)
    return cells[:, ::-1], np.minimum(slope * np.sqrt(spread), 1.0)[:, ::-1]


@lru_cache(maxsize=1)
def _steps() -> tuple[IntArray, IntArray]:
    """Return the steps to the lower and the upper neighbour along each axis, (2, 3, 3), and to all around, (26, 3)."""
    along = np.eye(3, dtype=np.int64)
    return np.stack([-along, along]), np.array(_NEIGHBOURS)


def _power(values: npt.NDArray[np.complex64]) -> npt.NDArray[np.float32]:
    return np.asarray(values.real**2 + values.imag**2)


def _axes(grid: CellGrid) -> tuple[_Axis, _Axis, _Axis]:
    """Return the axes of a grid in the order of its arrays: Doppler, range, angle."""
    return _known_axes(grid.waveform, grid.tapers)


@lru_cache(maxsize=8)
def _known_axes(waveform: Waveform, tapers: Tapers) -> tuple[_Axis, _Axis, _Axis]:
    return (
        _axis(waveform.symbols, tapers.doppler),
        _axis(waveform.subcarriers, tapers.range),
        _axis(waveform.antennas, tapers.angle),
    )


def _axis(count: int, taper: tuple[float, float]) -> _Axis:
    place = np.linspace(-0.75, 0.75, 301)
    upper, lower = (np.abs(kernel(step - place, count, taper)) for step in (1.0, -1.0))
    log_ratio = np.log(upper / lower)
    t0, t1 = taper
    apart = np.arange(count)[:, None] + np.linspace(-0.5, 0.5, 21)
    level = np.abs(kernel(apart, count, taper)).max(axis=1)
    # Sidelobes between cells count as well, and none is taken for lower than one farther out.
    highest = np.maximum.accumulate(level[: count // 2 + 1][::-1])[::-1]
    sidelobe = np.maximum(highest / highest[0], 1e-9) ** 2
    padded = np.concatenate([sidelobe, np.full(count - len(sidelobe), sidelobe[-1])])
    return _Axis(count, place, log_ratio, np.gradient(place, log_ratio), t1**2 / (t0**2 + 2 * t1**2), padded)
