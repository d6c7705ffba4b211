"""Motion conditioning: from raw 100 Hz states to smooth, consistent motion at any instant.

SUMO's 10 ms states are not physical: accelerations step, lateral motion freezes at markings, and vehicles turn at once
at the vertices of a lane's centre line. First, the corners of the road are rounded so that a car can follow it
(`isacsim.traffic.road_coordinates`). Then a zero-phase Gaussian filter in time smooths the positions. Velocity and
acceleration are the filter's derivatives, so the three agree at every instant, also between recorded ones.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict

import numpy as np
from scipy.ndimage import gaussian_filter1d

from isacsim.arrays import Array
from isacsim.scenarios.reference_line import RoundingSettings
from isacsim.traffic.recording import Recording, Track
from isacsim.traffic.road_coordinates import RoundedTrack, rounded_track

CAR_MPS2, CAR_MPS3 = 9.0, 25.0
"""The limits of a passenger car: acceleration, m/s2, and its rate of change, m/s3."""
REACH = 8.0
"""Half-width of the kernel in standard deviations. The weight beyond it is 1e-15."""


RECENT = 64
"""Tracks on rounded roads that are kept, because states of one vehicle are often needed several times."""


class MotionSettings(RoundingSettings):
    """How raw positions are conditioned."""


def condition(values: Array, step_s: float, width_s: float, order: int = 0, at_rows: Array | None = None) -> Array:
    """Smooth an evenly sampled signal with a Gaussian kernel, or differentiate the smoothed signal in time.

    values: one every step_s seconds, shape (n,).
    width_s: standard deviation of the kernel, s. 0.15 s leaves a lane change as it is, and a
        sixth of the amplitude at 2 Hz.
    order: 0 for the value, 1 for the first derivative (unit/s), 2 for the second (unit/s2).
    at_rows: rows to evaluate at, may be fractions, shape (m,); all n rows when absent.
    Beyond its ends the signal is continued by point reflection, which keeps value and slope there.
    Returns shape (m,).
    """
    sigma = width_s / step_s
    reach = int(np.ceil(REACH * sigma))
    base = float(values[0])
    padded = np.pad(values - base, reach, mode="reflect", reflect_type="odd")
    if at_rows is None:
        smooth = gaussian_filter1d(padded, sigma, order=order, radius=reach)[reach : reach + len(values)]
    else:
        nearest = np.rint(at_rows).astype(np.int64)
        taps = np.arange(-reach, reach + 1)
        u = ((at_rows - nearest)[:, None] - taps) / sigma
        weights = np.exp(-0.5 * u**2)
        weights /= weights.sum(axis=1, keepdims=True)
        if order == 1:
            weights *= -u / sigma
        elif order == 2:
            weights *= (u**2 - 1.0) / sigma**2
        smooth = np.einsum("mk,mk->m", weights, padded[nearest[:, None] + taps + reach])
    return np.asarray(smooth / step_s**order + (base if order == 0 else 0.0))


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
    return np.stack(
        [
            condition(values, recording.step_s, settings.width_s, order, rows)
            for order in (0, 1, 2)
            for values in (rounded.x, rounded.y)
        ]
    )


def beyond_car(recording: Recording, track: Track, settings: MotionSettings) -> Array:
    """Return the times at which a vehicle's conditioned motion in the plane is beyond a car, s, shape (k,).

    That is an acceleration over 9 m/s2, along and across together, or a change of it by over 25 m/s3.
    """
    rounded = on_rounded_road(recording, track, settings)
    acceleration = np.stack(
        [condition(values, recording.step_s, settings.width_s, 2) for values in (rounded.x, rounded.y)]
    )
    beyond = np.hypot(*acceleration) > CAR_MPS2
    beyond[1:] |= np.hypot(*np.diff(acceleration, axis=1)) > CAR_MPS3 * recording.step_s
    return np.asarray(recording.times(track)[beyond])


def on_rounded_road(recording: Recording, track: Track, settings: MotionSettings) -> RoundedTrack:
    """Return the positions of a track with the corners of its road rounded, from the recent ones where possible."""
    key = (id(track), settings.model_dump_json())
    reference, rounded = _RECENT.pop(key, (None, None))
    if rounded is None or reference is None or reference() is not track:
        rounded = rounded_track(recording, track, settings)
    _RECENT[key] = (weakref.ref(track), rounded)
    if len(_RECENT) > RECENT:
        _RECENT.popitem(last=False)
    return rounded


_RECENT: OrderedDict[tuple[int, str], tuple[weakref.ref[Track], RoundedTrack]] = OrderedDict()
