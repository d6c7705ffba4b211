"""Motion conditioning: from raw 100 Hz states to motion at any instant, smooth and consistent with itself.

SUMO's 10 ms states are not physical: accelerations step, lateral motion freezes at markings, positions jump at the
vertices of a curve. A zero-phase Gaussian on the positions mends that, and its derivatives *are* the velocity and the
acceleration, so that the three agree at every instant, also between the recorded ones.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.ndimage import gaussian_filter1d

from isacsim.arrays import Array
from isacsim.settings import Settings
from isacsim.traffic.recording import Recording, Track

REACH = 8.0
"""Half-width of the kernel in standard deviations: what is cut off weighs 1e-15."""


class MotionSettings(Settings):
    """How motion is conditioned."""

    width_s: float = Field(0.15, gt=0.0, le=1.0, description="standard deviation of the Gaussian kernel, s")


def condition(values: Array, step_s: float, width_s: float, order: int = 0, at_rows: Array | None = None) -> Array:
    """Gaussian-smoothed values of an evenly sampled signal, or their derivative in time.

    values: shape (n,), one every step_s seconds. width_s: standard deviation of the kernel, s; 0.15 s passes 2 Hz at
    one sixth and a lane change untouched. order: 0 value, 1 first derivative (unit/s), 2 second derivative (unit/s2).
    at_rows: where to evaluate, in rows, fractions allowed, shape (m,); all n rows when absent.
    Beyond its ends the signal is continued by point reflection, which keeps its value and slope there.
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
    """Conditioned state vectors of a vehicle at any instants within its track.

    times: simulation time, s, shape (n,), each within the track (a kernel's reach inside it, to be free of its ends).
    Returns x, y, vx, vy, ax, ay of the front bumper centre, shape (6, n), m, m/s, m/s2.
    Raises ValueError where a time lies outside the track.
    """
    rows = np.asarray(times) / recording.step_s - track.first_step
    if rows.min() < -1e-6 or rows.max() > len(track) - 1 + 1e-6:
        raise ValueError(f"vehicle {track.vehicle} has no state at some of {times.min():.2f}..{times.max():.2f} s")
    rows = np.clip(rows, 0, len(track) - 1)
    return np.stack(
        [
            condition(values, recording.step_s, settings.width_s, order, rows)
            for order in (0, 1, 2)
            for values in (track.x, track.y)
        ]
    )
