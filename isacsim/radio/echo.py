"""Echo synthesis by the DFT block: the few statistics of an echo on which its estimate depends, drawn exactly.

The full echo is 43,008 complex numbers, of which an estimator uses a handful: the cells around the peak of the DFT, and
near the maximum of the likelihood the value and the slopes of the matched filter. Both are inner products of the echo
with known vectors. White noise seen through orthonormal vectors is white, and seen through others it has their Gram
matrix as covariance, so these products can be drawn without the echo, jointly and with exactly the law they would have.

Two groups of vectors, in units where the noise has unit variance and a target the amplitude sqrt(rho N):

- **bins**: DFT cells about the target (whole cells, or half cells for a transform padded twofold);
- **moments**: the steering vector at the target times polynomials of the element number, up to the second degree. They
  give the matched filter near the target; at -30 dB the third degree, left out, moves an estimate by 3 % of its
  standard deviation, and less in proportion to the noise above.

The cells far from the target are not drawn; the largest of them stands for all (`Rival`). The slow oracle, which draws
all 43,008 numbers, is `isacsim.radio.echo_tensor`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import Literal

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray
from isac_cosim.isacsim.radio.waveform import Waveform, centred

Search = Literal["whole", "half", "pairs"]

BLOCK = 6
"""Width of the DFT block: search cells drawn along each axis, with the target between the middle two."""

DEGREES = (
    (0, 0, 0),
    *(tuple(int(axis == k) for k in range(3)) for axis in range(3)),
    *(
        tuple((first, second).count(k) for k in range(3))
        for first, second in combinations_with_replacement(range(3), 2)
    ),
)
"""Degree along each axis of the ten moments: value, three slopes, six curvatures (00, 01, 02, 11, 12, 22)."""


@dataclass(frozen=True)
class Rival:
    """The largest cell far from the target. power: shape (B,), in units of the noise. cells: where, shape (B, 3)."""

    power: Array
    cells: Array


@dataclass(frozen=True)
class Bins:
    """Search cells around the targets of B snapshots.

    values: (B, 6, 6, 6). first: coordinates of values[:, 0, 0, 0] in cells, (B, 3). spacing: cells between neighbours.
    """

    values: ComplexArray
    first: Array
    spacing: float
    rival: Rival


@dataclass(frozen=True)
class Moments:
    """The matched filter of B snapshots about the true targets.

    amplitude: of the target, sqrt(rho N), (B,). noise: of the moments in the order of DEGREES, (10, B).
    """

    amplitude: Array
    noise: ComplexArray


def white(shape: tuple[int, ...], rng: np.random.Generator) -> ComplexArray:
    """Circular complex Gaussian noise of unit variance."""
    pairs = rng.standard_normal((*shape, 2))
    pairs *= np.sqrt(0.5)
    return np.asarray(pairs.view(np.complex128)[..., 0])


def draw_moments(snr: Array, waveform: Waveform, rng: np.random.Generator) -> Moments:
    """Draw the moments of snapshots whose search cannot fail. snr: per-element, linear, (B,)."""
    return Moments(np.sqrt(snr * waveform.size), white((len(DEGREES), len(snr)), rng))


def draw_bins(cells: Array, snr: Array, search: Search, waveform: Waveform, rng: np.random.Generator) -> Bins:
    """Draw the DFT blocks around B targets.

    cells: true coordinates, (B, 3). snr: per-element, linear, (B,). search: which grid of cells.
    """
    spacing = 0.5 if search == "half" else 1.0
    first = (np.ceil(cells / spacing) - BLOCK // 2) * spacing
    responses = [_response(cells[:, axis] - first[:, axis], spacing, axis, 0, waveform) for axis in range(3)]
    values = white((len(snr), BLOCK, BLOCK, BLOCK), rng)
    if search == "half":
        values = np.einsum(
            "ai,bj,ck,nijk->nabc", *(_colour(axis, waveform) for axis in range(3)), values, optimize=True
        )
    values += np.sqrt(snr * waveform.size)[:, None, None, None] * (
        responses[0][:, :, None, None] * responses[1][:, None, :, None] * responses[2][:, None, None, :]
    )
    return Bins(values, first, spacing, _draw_rival(len(snr), search, waveform, rng))


def draw_search(cells: Array, snr: Array, waveform: Waveform, rng: np.random.Generator) -> tuple[Bins, Moments]:
    """Draw whole search cells and moments of the same snapshots, with their joint law. Arguments as in `draw_bins`.

    The noise of the moments has a part within the drawn cells, computed from their values, and a part outside, whose
    covariance is what the cells leave of the identity.
    """
    bins = draw_bins(cells, snr, "pairs", waveform, rng)
    responses = np.stack(
        [
            np.stack(
                [_response(cells[:, k] - bins.first[:, k], 1.0, k, degree, waveform) for degree in range(3)], axis=1
            )
            for k in range(3)
        ]
    )  # (axis, B, degree, cell)
    amplitude = np.sqrt(snr * waveform.size)
    signal = np.einsum("ni,nj,nk->nijk", *responses[:, :, 0])
    noise = bins.values - amplitude[:, None, None, None] * signal
    inside = np.einsum("nai,nbj,nck,nijk->nabc", *responses, noise, optimize=True)
    gram = np.einsum("xnai,xnbi->xnab", responses, responses)
    degree = np.array(DEGREES)
    drawn = [gram[k][:, degree[:, None, k], degree[None, :, k]] for k in range(3)]
    left = np.eye(len(DEGREES)) - np.prod(drawn, axis=0)
    factor = np.linalg.cholesky(left + 1e-12 * np.eye(len(DEGREES)))
    outside = np.einsum("nab,nb->an", factor, white((len(snr), len(DEGREES)), rng))
    return bins, Moments(amplitude, inside[:, degree[:, 0], degree[:, 1], degree[:, 2]].T + outside)


def fourth_moment(count: int) -> float:
    """Mean fourth power of the element number about the centre, scaled to unit mean square."""
    return 3 * (3 * count**2 - 7) / (5 * (count**2 - 1))


def spread(count: int) -> float:
    """Root mean square of the element number about the centre of an axis: sqrt((N^2 - 1) / 12)."""
    return float(np.sqrt((count**2 - 1) / 12))


_TABLE_STEP = 1 / 1024


@lru_cache(maxsize=32)
def _kernel(count: int, degree: int) -> tuple[Array, Array]:
    """Tabulate the moment of `degree` of a unit tone over its distance in cells: the Dirichlet kernel and its slopes.

    Degree d is the d-th derivative of the matched filter over the scaled frequency, made orthonormal: real for every d
    because elements are counted from the centre.
    """
    distance = np.arange(-BLOCK, BLOCK + _TABLE_STEP / 2, _TABLE_STEP)
    element = centred(count)
    scaled = element / spread(count)
    phase = 2 * np.pi / count * np.multiply.outer(distance, element)
    if degree == 0:
        return distance, np.cos(phase).mean(axis=1)
    if degree == 1:
        return distance, -(np.sin(phase) * scaled).mean(axis=1)
    curvature = (scaled**2 - 1) / np.sqrt(fourth_moment(count) - 1)
    return distance, -(np.cos(phase) * curvature).mean(axis=1)


def _response(offset: Array, spacing: float, axis: int, degree: int, waveform: Waveform) -> Array:
    """Moment of each drawn cell's unit tone about targets `offset` cells after the first one, (B,) -> (B, 6)."""
    distance, values = _kernel(waveform.shape[axis], degree)
    return np.interp(offset[:, None] - spacing * np.arange(BLOCK), distance, values)


@lru_cache(maxsize=8)
def _colour(axis: int, waveform: Waveform) -> Array:
    """Factor of the covariance of neighbouring half cells along an axis, (6, 6): they overlap."""
    distance, values = _kernel(waveform.shape[axis], 0)
    offset = 0.5 * np.arange(BLOCK)
    return np.asarray(np.linalg.cholesky(np.interp(offset[:, None] - offset, distance, values) + 1e-12 * np.eye(BLOCK)))


_CELLS_PER_ELEMENT: dict[Search, tuple[float, float]] = {
    "whole": (1.0, 0.0),
    "half": (6.57, 0.065),
    "pairs": (4.16, 0.217),
}


def _draw_rival(count: int, search: Search, waveform: Waveform, rng: np.random.Generator) -> Rival:
    """Draw the largest of the search cells that hold noise alone.

    The power of one is exponential, so the largest of n independent ones is -ln(1 - U^(1/n)). Cells of a grid finer
    than the transform overlap; they count as g N with g = a + b x, at most 8, at the level x, measured on noise alone
    (`benchmarks/findings/sensing/search_cells.py`). The place is uniform.
    """
    base, slope = _CELLS_PER_ELEMENT[search]
    rare = rng.standard_exponential(count)
    power = np.full(count, np.log(waveform.size))
    for _ in range(4):
        power = -np.log(-np.expm1(-rare / (waveform.size * np.minimum(base + slope * power, 8))))
    cells = rng.random((count, 3)) * waveform.shape
    if search != "pairs":
        spacing = 0.5 if search == "half" else 1.0
        cells = np.floor(cells / spacing) * spacing
    return Rival(power, cells)
