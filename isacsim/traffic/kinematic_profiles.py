"""The shapes that kinematic motion is made of: pulses of acceleration, moves aside, and sway.

Time is an array throughout, so that a whole trajectory is evaluated at once.
"""

from __future__ import annotations

import numpy as np

from isacsim.arrays import Array


def pulse(times: Array, start: float, peak: float, ramp_s: float, hold_s: float) -> Array:
    """Return a pulse of acceleration: a rise and a fall shaped like a half cosine, with a plateau in between.

    times: s, shape (n,). start: when it begins, s. peak: height of the plateau, m/s2, of either sign. ramp_s: duration
    of the rise and of the fall, s. hold_s: duration of the plateau, s.
    Returns m/s2, shape (n,). The speed changes by peak * (ramp_s + hold_s); the jerk is at most pi * |peak| /
    (2 * ramp_s).
    """
    rise = np.clip((times - start) / ramp_s, 0.0, 1.0)
    fall = np.clip((times - start - ramp_s - hold_s) / ramp_s, 0.0, 1.0)
    return np.asarray(peak * (np.cos(np.pi * fall) - np.cos(np.pi * rise)) / 2)


def ramp_of(peak: float, jerk_mps3: float) -> float:
    """Return the duration of the rise of a pulse that reaches `peak`, m/s2, with a largest jerk, m/s3, in s."""
    return float(np.pi * abs(peak) / (2 * jerk_mps3))


def move_aside(times: Array, start: float, distance_m: float, duration_s: float) -> Array:
    """Return a move aside whose lateral acceleration is one period of a sine.

    times: s, shape (n,). start: when it begins, s. distance_m: left positive, m.
    Returns the lateral position, m, shape (n,). The largest lateral speed is 2 * distance_m / duration_s and the
    largest acceleration 2 * pi * distance_m / duration_s ** 2.
    """
    share = np.clip((times - start) / duration_s, 0.0, 1.0)
    return np.asarray(distance_m * (share - np.sin(2 * np.pi * share) / (2 * np.pi)))


def duration_of(distance_m: float, peak_mps2: float) -> float:
    """Return how long a move aside with a largest lateral acceleration takes, s."""
    return float(np.sqrt(2 * np.pi * abs(distance_m) / peak_mps2))


def sway(times: Array, amplitude: float, period_s: float, phase: float) -> Array:
    """Return a sine: how a driver wanders about a steady value. phase: rad. Shape (n,), in the amplitude's unit."""
    return np.asarray(amplitude * np.sin(2 * np.pi * times / period_s + phase))


def integral(rates: Array, step_s: float, first: float = 0.0) -> Array:
    """Return the integral of an evenly sampled signal by the trapezoidal rule, shape (n,), beginning with `first`."""
    return np.asarray(first + np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2 * step_s)]))
