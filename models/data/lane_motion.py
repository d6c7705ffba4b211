"""The motion of a window's TV relative to the lanes: along and across, in the direction of the lane at each sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.models.data.lane_map import InLane
from isac_cosim.models.data.windows import OnMap

HEADING_STEP_S = 0.2
"""Approximate time between the instants at which the direction of the lane is looked up."""
PARTS = ((slice(0, 2), 2), (slice(2, 4), 1))
"""Positions and velocities among the states, and the order of the polynomials that smooth them."""


@dataclass(frozen=True)
class LaneMotion:
    """The motion of the TVs of n windows of T samples.

    heading: direction of the lane at each sample, unit vectors (n, 2, T). along, across: velocity along the lane, and
    across it to the left, m/s, (n, T). position: smoothed, at the end, m, (n, 2). offset_m: at the end, from the centre
    line of the lane in which the TV began the window, positive to the left, m, (n,). width_m: of that lane, (n,).
    span: number of samples of the fits that smooth, an odd number.
    """

    heading: Array
    along: Array
    across: Array
    position: Array
    offset_m: Array
    width_m: Array
    span: int

    @classmethod
    def of(cls, on_map: OnMap, smooth_s: float) -> Self:
        """Return the motion of windows on their roads. smooth_s: span of the smoothing fits, s."""
        n_samples = on_map.tv.shape[2]
        # A parabola needs three samples.
        span = max(3, min(2 * int(smooth_s * on_map.tv_rate_hz / 2) + 1, n_samples - (n_samples + 1) % 2))
        count = 2 + round(n_samples / (HEADING_STEP_S * on_map.tv_rate_hz))
        instants = np.unique(np.linspace(0, n_samples - 1, count).astype(np.int64))
        # Parabolas for positions, because a bend is not a straight line over half a second.
        smooth = np.concatenate(
            [smoothed(on_map.tv[:, part], span, order, tuple(instants.tolist())) for part, order in PARTS], axis=1
        )
        heading = _headings(on_map, smooth, instants)
        # Velocities are turned into the lane before they are differentiated: in the lane, a bend is no acceleration.
        along = np.einsum("nkt,nkt->nt", heading, on_map.tv[:, 2:4])
        across = heading[:, 0] * on_map.tv[:, 3] - heading[:, 1] * on_map.tv[:, 2]
        start = places(on_map, smooth[:, :2, 0], smooth[:, 2:4, 0])
        moved = np.trapezoid(across, dx=1 / on_map.tv_rate_hz, axis=1)
        return cls(heading, along, across, smooth[:, :2, -1], start.offset_m + moved, start.width_m, span)


def places(on_map: OnMap, position: Array, velocity: Array, repeat: int = 1) -> InLane:
    """Return the places in lanes of (n repeat, 2) positions and velocities, `repeat` of each window in turn."""
    scenario = np.repeat(on_map.scenario, repeat)
    offset, width, heading = np.empty(len(position)), np.empty(len(position)), np.empty((len(position), 2))
    for name in dict.fromkeys(on_map.scenario.tolist()):
        rows = scenario == name
        place = on_map.lane_maps(name).place(position[rows], velocity[rows])
        offset[rows], width[rows], heading[rows] = place.offset_m, place.width_m, place.heading
    return InLane(offset, width, heading)


def smoothed(values: Array, span: int, order: int, instants: tuple[int, ...]) -> Array:
    """Return values (..., T) as a Savitzky-Golay filter smooths them at some samples, (..., len(instants)).

    span: samples of the fit, an odd number. order: of its polynomial. Nearer to the ends than half a span, the fit is
    that of the first or last span.
    """
    return values @ _weights(values.shape[-1], span, order, instants).T


@lru_cache(maxsize=16)
def _weights(count: int, span: int, order: int, instants: tuple[int, ...]) -> Array:
    """Return the weights of `count` samples in the smoothed value at each instant, (len(instants), count)."""
    from scipy.signal import savgol_coeffs  # loaded only here, because it takes a second

    weights = np.zeros((len(instants), count))
    for row, instant in zip(weights, instants, strict=True):
        first = min(max(instant - span // 2, 0), count - span)
        row[first : first + span] = savgol_coeffs(span, order, pos=instant - first, use="dot")
    return weights


def slopes(values: Array, span: int) -> Array:
    """Return the slope, per sample, of the straight line through each `span` values in turn, (n, T - span + 1).

    values: (n, T). span: an odd number. Running sums make it as fast for a long span as for a short one.
    """
    number = np.arange(values.shape[1])
    sums, moments = (
        np.concatenate([np.zeros((len(values), 1)), np.cumsum(part, axis=1)], axis=1)
        for part in (values, number * values)
    )
    middle = number[: values.shape[1] - span + 1] + span // 2
    moment = moments[:, span:] - moments[:, :-span] - middle * (sums[:, span:] - sums[:, :-span])
    return np.asarray(moment / (span * (span**2 - 1) / 12.0))


def _headings(on_map: OnMap, smooth: Array, instants: IntArray) -> Array:
    """Return the direction of the lane at every TV sample, unit vectors (n, 2, T).

    smooth: smoothed positions and velocities at `instants`, (n, 4, m). instants: samples at which the direction is
    looked up, (m,); it is interpolated between them.
    """
    n, count = len(on_map.tv), len(instants)
    flat = np.moveaxis(smooth, 1, 2).reshape(n * count, 4)
    heading = places(on_map, flat[:, :2], flat[:, 2:], repeat=count).heading.reshape(n, count, 2)
    angle = np.unwrap(np.arctan2(heading[..., 1], heading[..., 0]), axis=1)
    samples = np.arange(on_map.tv.shape[2])
    interpolated = np.stack([np.interp(samples, instants, row) for row in angle])
    return np.stack([np.cos(interpolated), np.sin(interpolated)], axis=1)
