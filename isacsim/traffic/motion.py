"""Motion conditioning: from raw 100 Hz states to smooth, consistent motion at any instant.

SUMO's 10 ms states are not physical: accelerations step, lateral motion freezes at markings, and vehicles turn at once
at the vertices of a lane's centre line. First, the corners of the road are rounded so that a car can follow it
(`isacsim.traffic.road_coordinates`). Then a zero-phase Gaussian filter in time smooths the positions. Velocity and
acceleration are the filter's derivatives, so the three agree at every instant, also between recorded ones.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from isac_cosim.base.arrays import Array, BoolArray, ComplexArray, IntArray, reflected
from isac_cosim.isacsim.scenarios.reference_line import RoundingSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.road_coordinates import MovedRows, RoundedTrack, lane_headings, moved_rows

CAR_MPS2, CAR_MPS3 = 9.0, 25.0
"""The limits of a passenger car: acceleration, m/s2, and its rate of change, m/s3."""
REACH = 8.0
"""Half-width of the kernel in standard deviations. The weight beyond it is 1e-15."""


LEAST_MPS = 1.0
"""Below, a vehicle has no direction of travel, m/s."""
COARSE_ROWS = 3
"""Motion is looked at this often in the standard deviation of the kernel before it is looked at in full."""
ALMOST = 0.75
"""Share of a limit from which on motion that was looked at coarsely is looked at in full."""
LEAST_HEADING = 1e-6
"""Shorter mean vectors along a road, as where it turns back at once, have no direction."""
SAME_PHASE = 1e-9
"""Instants whose places between two rows differ by less than this use the same weights, rows."""


class MotionSettings(RoundingSettings):
    """How raw positions are conditioned."""


def condition(
    values: Array, step_s: float, width_s: float, order: int = 0, at_rows: Array | IntArray | None = None
) -> Array:
    """Smooth an evenly sampled signal with a Gaussian kernel, or differentiate the smoothed signal in time.

    values: one every step_s seconds, shape (n,).
    width_s: standard deviation of the kernel, s. 0.15 s leaves a lane change as it is, and a
        sixth of the amplitude at 2 Hz.
    order: 0 for the value, 1 for the first derivative (unit/s), 2 for the second (unit/s2).
    at_rows: rows to evaluate at, may be fractions, shape (m,); all n rows when absent.
    Beyond its ends the signal is continued by point reflection, which keeps value and slope there.
    Returns shape (m,).
    """
    if at_rows is not None:
        return np.asarray(condition_at(values, step_s, width_s, (order,), at_rows)[0])
    padded, base, sigma, reach = _padded(values, step_s, width_s)
    smooth = gaussian_filter1d(padded, sigma, order=order, radius=reach)[reach : reach + len(values)]
    return np.asarray(smooth / step_s**order + (base if order == 0 else 0.0))


def condition_at(
    values: Array, step_s: float, width_s: float, orders: Sequence[int], at_rows: Array | IntArray
) -> Array:
    """Return what `condition` returns for each of several orders, shape (k, m).

    Instants at a fixed rate have few different places between two rows, and those of one place share their weights.
    """
    padded, base, sigma, reach = _padded(values, step_s, width_s)
    nearest = np.rint(at_rows).astype(np.int64)
    phases, phase_of = np.unique(np.rint((at_rows - nearest) / SAME_PHASE), return_inverse=True)
    windows = sliding_window_view(padded, 2 * reach + 1)
    smooth = np.empty((len(orders), len(at_rows)))
    for k, phase in enumerate(phases.tolist()):
        mask = phase_of == k
        around = _selected(windows, nearest[mask])
        for row, order in zip(smooth, orders, strict=True):
            row[mask] = np.einsum("mk,k->m", around, _weights(phase * SAME_PHASE, sigma, reach, order))
    for row, order in zip(smooth, orders, strict=True):
        row /= step_s**order
        row += base if order == 0 else 0.0
    return smooth


def _selected(windows: Array, rows: IntArray) -> Array:
    """Return some of the windows: a view where the rows are evenly spaced, because copying them takes longest."""
    step = int(rows[1] - rows[0]) if len(rows) > 1 else 1
    if step > 0 and (np.diff(rows) == step).all():
        return windows[rows[0] : rows[-1] + 1 : step]
    return windows[rows]


def _padded(values: Array, step_s: float, width_s: float) -> tuple[Array, float, float, int]:
    """Return a signal less its first value, continued beyond its ends, and that value; the kernel's sigma and reach.

    sigma, reach: standard deviation and half-width of the kernel, rows.
    """
    sigma, base = width_s / step_s, float(values[0])
    reach = int(np.ceil(REACH * sigma))
    return reflected(values - base, reach, reach), base, sigma, reach


@lru_cache(maxsize=64)
def _weights(phase: float, sigma: float, reach: int, order: int) -> Array:
    """Return the weights of a Gaussian kernel or its derivatives, centred `phase` rows after the middle one."""
    u = (phase - np.arange(-reach, reach + 1)) / sigma
    weights = np.exp(-0.5 * u**2)
    weights /= weights.sum()
    if order == 1:
        weights *= -u / sigma
    elif order == 2:
        weights *= (u**2 - 1.0) / sigma**2
    weights.flags.writeable = False
    return np.asarray(weights)


def states(recording: Recording, track: Track, times: Array, settings: MotionSettings) -> Array:
    """Return conditioned states of a vehicle at any instants within its track.

    times: simulation time, s, shape (n,). States closer to an end of the track than the kernel's reach depend on how
    the track is continued there.
    Returns x, y, vx, vy, ax, ay of the front bumper centre in m, m/s, m/s2, shape (6, n). The road's corners are
    rounded, by at most `settings.max_shift_m` at the centre line.
    Raises ValueError where a time lies outside the track.
    """
    rows = np.asarray(times) / recording.step_s - track.first_step
    if rows.min() < -1e-6 or rows.max() > len(track) - 1 + 1e-6:
        raise ValueError(f"vehicle {track.vehicle} has no state at some of {times.min():.2f}..{times.max():.2f} s")
    rows = np.clip(rows, 0, len(track) - 1)
    rounded = on_rounded_road(recording, track, settings)
    x, y = (
        condition_at(values, recording.step_s, settings.width_s, (0, 1, 2), rows) for values in (rounded.x, rounded.y)
    )
    return np.stack([x, y], axis=1).reshape(6, -1)


def positions(recording: Recording, track: Track, steps: IntArray, settings: MotionSettings) -> Array:
    """Return the conditioned positions of a vehicle at steps of the recording within its track, m, shape (2, n)."""
    rounded, rows = on_rounded_road(recording, track, settings), steps - track.first_step
    return np.stack(
        [condition(values, recording.step_s, settings.width_s, 0, rows) for values in (rounded.x, rounded.y)]
    )


@dataclass(frozen=True)
class Excess:
    """When a vehicle's conditioned motion in the plane exceeds limits, s of simulation time.

    beyond_car: the acceleration exceeds 9 m/s2, along and across together, or changes by more than 25 m/s3, shape (k,).
    across: the acceleration across the direction of travel exceeds the limit that was given, shape (m,).
    along: the acceleration along the road differs from that of the recorded speed by more than the limit that was
    given, shape (l,).
    """

    beyond_car: Array
    across: Array
    along: Array


def excess(
    recording: Recording,
    track: Track,
    settings: MotionSettings,
    across_mps2: float | None = None,
    along_mps2: float | None = None,
) -> Excess:
    """Return when a vehicle's conditioned motion in the plane exceeds the limits of a car, and two limits of its own.

    across_mps2: limit of the acceleration across the direction of travel, m/s2; none when absent. Below `LEAST_MPS`, a
    vehicle has no direction of travel. along_mps2: limit of the difference along the road between the acceleration in
    the plane and that of the recorded speed, m/s2; none when absent.
    """
    rounded, step_s, width_s = on_rounded_road(recording, track, settings), recording.step_s, settings.width_s
    every = max(1, int(width_s / step_s / COARSE_ROWS))
    coarse = _coarse_acceleration(rounded, step_s, width_s, every)
    total = np.hypot(*coarse)
    jerk = np.hypot(*np.diff(coarse, axis=1)) / (every * step_s)
    suspect = total > ALMOST * CAR_MPS2
    suspect[1:] |= jerk > ALMOST * CAR_MPS3
    rows = _around(suspect, every, len(track))
    beyond = rows[:0]
    if len(rows):
        (acceleration,) = _derivatives(rounded, step_s, width_s, (2,), rows)
        exceeds = np.hypot(*acceleration) > CAR_MPS2
        next_row = np.diff(rows) == 1
        exceeds[1:] |= next_row & (np.hypot(*np.diff(acceleration, axis=1)) > CAR_MPS3 * step_s)
        beyond = rows[exceeds]
    across = rows[:0]
    limit = np.inf if across_mps2 is None else across_mps2
    rows = _around(total > ALMOST * limit, every, len(track))
    if len(rows):
        velocity, acceleration = _derivatives(rounded, step_s, width_s, (1, 2), rows)
        across = rows[np.abs(across_travel(velocity, acceleration)) > limit]
    times = recording.times(track)
    along = rows[:0] if along_mps2 is None else _astray(recording, track, settings, coarse, every, along_mps2)
    return Excess(times[beyond], times[across], times[along])


def _astray(
    recording: Recording, track: Track, settings: MotionSettings, coarse: Array, every: int, limit_mps2: float
) -> IntArray:
    """Return the rows at which the acceleration along the road differs from that of the speed by more than a limit.

    coarse: the acceleration in the plane at every `every`-th row, m/s2, shape (2, n).
    """
    if not recording.lanes:
        return np.empty(0, np.int64)
    headings, step_s, width_s = road_headings(recording, track, settings), recording.step_s, settings.width_s

    def difference(rows: IntArray, acceleration: Array) -> Array:
        road = np.stack([condition_at(part, step_s, width_s, (0,), rows)[0] for part in (headings.real, headings.imag)])
        along = (acceleration * road).sum(axis=0) / np.maximum(np.hypot(*road), LEAST_HEADING)
        return np.asarray(np.abs(along - condition_at(track.speed, step_s, width_s, (1,), rows)[0]))

    suspect = difference(np.arange(0, len(track), every), coarse) > ALMOST * limit_mps2
    rows = _around(suspect, every, len(track))
    if not len(rows):
        return rows
    (acceleration,) = _derivatives(on_rounded_road(recording, track, settings), step_s, width_s, (2,), rows)
    return rows[difference(rows, acceleration) > limit_mps2]


def road_headings(recording: Recording, track: Track, settings: MotionSettings) -> ComplexArray:
    """Return the direction of the rounded road at each row of a track, as complex unit vectors, shape (n,)."""
    headings, moved = lane_headings(recording.lanes, track.lane, track.lane_pos), _moved(recording, track, settings)
    headings[moved.rows] = moved.heading
    return headings


def _around(suspect: BoolArray, every: int, count: int) -> IntArray:
    """Return the rows, of `count`, around those of every `every`-th row that are suspect."""
    near = np.repeat(maximum_filter1d(suspect.astype(np.int8), 3), every)[:count]
    return np.flatnonzero(near)


def across_travel(velocity: Array, acceleration: Array) -> Array:
    """Return the acceleration across the direction of travel, left positive, m/s2, shape (n,).

    velocity, acceleration: in the plane, m/s and m/s2, shape (2, n). Zero at speeds below `LEAST_MPS`.
    """
    speed = np.hypot(*velocity)
    turning = velocity[0] * acceleration[1] - velocity[1] * acceleration[0]
    return np.asarray(np.where(speed > LEAST_MPS, turning, 0.0) / np.maximum(speed, LEAST_MPS))


def _derivatives(rounded: RoundedTrack, step_s: float, width_s: float, orders: Sequence[int], rows: IntArray) -> Array:
    """Return derivatives in time of the smoothed positions at some rows, shape (k, 2, n)."""
    return np.stack([condition_at(values, step_s, width_s, orders, rows) for values in (rounded.x, rounded.y)], axis=1)


def _coarse_acceleration(rounded: RoundedTrack, step_s: float, width_s: float, every: int) -> Array:
    """Return the acceleration of the smoothed positions at every `every`-th row, m/s2, shape (2, n).

    Conditioned motion changes little within a third of the kernel's standard deviation.
    """
    acceleration = []
    for values in (rounded.x, rounded.y):
        padded, _, sigma, reach = _padded(values, step_s, width_s)
        windows = sliding_window_view(padded, 2 * reach + 1)[::every]
        acceleration.append(np.einsum("mk,k->m", windows, _weights(0.0, sigma, reach, 2)))
    return np.stack(acceleration) / step_s**2


def on_rounded_road(recording: Recording, track: Track, settings: MotionSettings) -> RoundedTrack:
    """Return the positions of a track with the corners of its road rounded."""
    return RoundedTrack.of(track, _moved(recording, track, settings))


def _moved(recording: Recording, track: Track, settings: MotionSettings) -> MovedRows:
    """Return what rounding moves; it is worked out once for each track and kept as long as the track is."""
    key = (id(track), settings.model_dump_json())
    if key not in _MOVED:
        moved = moved_rows(recording, track, settings)
        _MOVED[key] = moved, weakref.ref(track, lambda _: _MOVED.pop(key, None))
    return _MOVED[key][0]


_MOVED: dict[tuple[int, str], tuple[MovedRows, weakref.ref[Track]]] = {}


MOST_PHASES = 64
"""With more sets of weights than this nothing is gained."""


def even_states(
    recording: Recording, track: Track, start_s: float, count: int, rate_hz: float, settings: MotionSettings
) -> Array:
    """Return conditioned states of a vehicle at `count` instants within its track, the first at start_s.

    start_s: simulation time, s. rate_hz: instants per second.
    Returns x, y, vx, vy, ax, ay of the front bumper centre in m, m/s, m/s2, shape (6, count), as `states` does.
    Raises ValueError where an instant lies outside the track.
    """
    stride = Fraction(1 / (rate_hz * recording.step_s)).limit_denominator(MOST_PHASES)
    times = start_s + np.arange(count) / rate_hz
    rows = times / recording.step_s - track.first_step
    exact = abs(float(stride) - 1 / (rate_hz * recording.step_s)) * count < 1e-9
    if not exact or count == 0 or rows[0] < 0 or rows[-1] > len(track) - 1:
        return states(recording, track, times, settings)
    rounded = on_rounded_road(recording, track, settings)
    sigma = settings.width_s / recording.step_s
    reach = int(np.ceil(REACH * sigma))
    conditioned = np.empty((6, count))
    for axis, values in enumerate((rounded.x, rounded.y)):
        base = float(values[0])
        padded = reflected(values - base, reach, reach)
        for phase in range(min(stride.denominator, count)):
            of_phase = slice(phase, count, stride.denominator)
            nearest = round(float(rows[phase]))
            last = nearest + (len(range(count)[of_phase]) - 1) * stride.numerator
            around = padded[nearest : last + 2 * reach + 1]
            for order, weights in enumerate(_weights_of_orders(float(rows[phase]) - nearest, sigma, reach)):
                smooth = np.correlate(around, weights, mode="valid")[:: stride.numerator]
                conditioned[2 * order + axis, of_phase] = smooth / recording.step_s**order
        conditioned[axis] += base
    return conditioned


def _weights_of_orders(offset: float, sigma: float, reach: int) -> tuple[Array, Array, Array]:
    """Return the weights of the kernel and of its two derivatives, by the row, about a fraction of a row."""
    u = (offset - np.arange(-reach, reach + 1)) / sigma
    weights = np.exp(-0.5 * u**2)
    weights /= weights.sum()
    return weights, weights * -u / sigma, weights * (u**2 - 1.0) / sigma**2
