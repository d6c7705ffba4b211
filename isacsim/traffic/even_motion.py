"""Motion conditioning at evenly spaced instants: what `isacsim.traffic.motion.states` gives, in a fraction of the time.

If a few sampling intervals make a whole number of recording steps, as at 400 Hz on a recording at 100 Hz, the kernel
has the same weights at every so many instants. Each set of weights is computed once and correlated with the positions.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from isacsim.arrays import Array, reflected
from isacsim.traffic import motion
from isacsim.traffic.motion import REACH, MotionSettings
from isacsim.traffic.recording import Recording, Track

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
        return motion.states(recording, track, times, settings)
    rounded = motion.on_rounded_road(recording, track, settings)
    sigma = settings.width_s / recording.step_s
    reach = int(np.ceil(REACH * sigma))
    states = np.empty((6, count))
    for axis, values in enumerate((rounded.x, rounded.y)):
        base = float(values[0])
        padded = reflected(values - base, reach, reach)
        for phase in range(min(stride.denominator, count)):
            of_phase = slice(phase, count, stride.denominator)
            nearest = round(float(rows[phase]))
            last = nearest + (len(range(count)[of_phase]) - 1) * stride.numerator
            around = padded[nearest : last + 2 * reach + 1]
            for order, weights in enumerate(_weights(float(rows[phase]) - nearest, sigma, reach)):
                smooth = np.correlate(around, weights, mode="valid")[:: stride.numerator]
                states[2 * order + axis, of_phase] = smooth / recording.step_s**order
        states[axis] += base
    return states


def _weights(offset: float, sigma: float, reach: int) -> tuple[Array, Array, Array]:
    """Return the weights of the kernel and of its two derivatives, by the row, about a fraction of a row."""
    u = (offset - np.arange(-reach, reach + 1)) / sigma
    weights = np.exp(-0.5 * u**2)
    weights /= weights.sum()
    return weights, weights * -u / sigma, weights * (u**2 - 1.0) / sigma**2
