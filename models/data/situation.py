"""What a window says of the situation: how the TV moves in its lane, where lanes go on, and how it stands to the UV.

A predictor that was trained on maneuvers after their onset need not know what announces one. These quantities do: the
TV's accelerations and lateral speeds one after the other, the lanes that it could change to, and the conflict with the
UV, such as the deceleration that it takes to stay behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.models.data.lane_motion import LaneMotion, places
from isac_cosim.models.data.windows import OnMap

ALONG_S, ACROSS_S, INSTANT_S = 0.2, 0.3, 0.1
"""Spans over which accelerations along and across the lane, and speeds, are averaged, s."""
ACCELERATION_AGES_S = (0.0, 0.2, 0.4, 0.7, 1.0, 1.5)
"""How long before the end of the window each span of an acceleration along the lane ends, s."""
ACROSS_AGES_S = (0.0, 0.3, 0.6, 1.0, 1.5)
"""The same of accelerations across the lane, and of the UV's accelerations, s."""
ASIDE_AGES_S = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0)
"""The same of speeds across the lane, s."""
MOVED_S = (0.5, 1.0, 1.5)
"""Times over which the way across the lane is taken, s; beside them, over the whole window."""
AHEAD_M = (0.0, 50.0, 120.0)
"""Distances ahead at which the lanes are looked up, m."""
VEHICLE_M = 5.0
"""Length of a UV, m, because reports do not say it."""
LONGEST_S, LARGEST_MPS2 = 60.0, 20.0
"""Times and decelerations end here."""

FEATURES = (
    *(f"acceleration_{age:g}" for age in ACCELERATION_AGES_S),
    "acceleration_least",
    "acceleration_most",
    *(f"across_acceleration_{age:g}" for age in ACROSS_AGES_S),
    "across_acceleration_least",
    "across_acceleration_most",
    "speed",
    "speed_first",
    *(f"aside_{age:g}" for age in ASIDE_AGES_S),
    *(f"moved_{time:g}" for time in MOVED_S),
    "moved",
    "offset",
    "width",
    "left_crossing_s",
    "right_crossing_s",
    *(f"{side}_{ahead:g}" for side in ("left", "right", "own") for ahead in AHEAD_M),
    "gap",
    "uv_aside",
    "uv_speed",
    "uv_speed_first",
    *(f"uv_acceleration_{age:g}" for age in ACROSS_AGES_S),
    "closing",
    "closing_faster",
    "headway_s",
    "ttc_s",
    "needed",
    "needed_if_uv_stops",
    "uv_moves_aside",
    "uv_moved_aside",
    "uv_offset",
)
"""The names of the features. A number in a name is an age, a time (s) or a distance ahead (m)."""


@dataclass(frozen=True)
class _Ends:
    """Values (n, T) at a rate, read near their end."""

    values: Array
    rate_hz: float

    def mean(self, age_s: float, span_s: float) -> Array:
        """Return the mean over a span that ends at an age, (n,)."""
        return np.asarray(self._span(age_s, span_s).mean(axis=1))

    def slope(self, age_s: float, span_s: float) -> Array:
        """Return the slope over a span that ends at an age, per second, (n,)."""
        span = self._span(age_s, span_s)
        time_s = (np.arange(span.shape[1]) - (span.shape[1] - 1) / 2) / self.rate_hz
        return np.asarray(span @ time_s / (time_s @ time_s))

    def slopes(self, span_s: float) -> Array:
        """Return the slopes over all spans that fit, one after the other, per second, (n, m)."""
        starts = np.arange(0.0, self.values.shape[1] / self.rate_hz - span_s / 2, span_s / 2)
        return np.stack([self.slope(age, span_s) for age in starts.tolist()], axis=1)

    def _span(self, age_s: float, span_s: float) -> Array:
        samples = self.values.shape[1]
        count = min(max(2, round(span_s * self.rate_hz)), samples)
        last = max(samples - round(age_s * self.rate_hz), count)
        return self.values[:, last - count : last]


def situation(on_map: OnMap, motion: LaneMotion) -> Array:
    """Return FEATURES of n windows, (n, F). Lengths are in m, times in s, speeds in m/s and accelerations in m/s2.

    Sides are positive to the left. motion: that of the TVs relative to their lanes.
    """
    along, across = _Ends(motion.along, on_map.tv_rate_hz), _Ends(motion.across, on_map.tv_rate_hz)
    window_s = on_map.tv.shape[2] / on_map.tv_rate_hz
    columns: list[Array] = [along.slope(age, ALONG_S) for age in ACCELERATION_AGES_S]
    columns += _extremes(along.slopes(ALONG_S))
    columns += [across.slope(age, ACROSS_S) for age in ACROSS_AGES_S]
    columns += _extremes(across.slopes(ACROSS_S))
    speed, aside = along.mean(0.0, INSTANT_S), across.mean(0.0, INSTANT_S)
    columns += [speed, along.mean(window_s, INSTANT_S)]
    columns += [across.mean(age, INSTANT_S) for age in ASIDE_AGES_S]
    columns += [time * across.mean(0.0, time) for time in (*MOVED_S, window_s)]
    columns += _lanes(on_map, motion, aside)
    columns += _to_uv(on_map, motion, speed, along.slope(0.0, ACROSS_S))
    return np.stack(columns, axis=1)


def _extremes(values: Array) -> list[Array]:
    return [values.min(axis=1), values.max(axis=1)]


def _lanes(on_map: OnMap, motion: LaneMotion, aside: Array) -> list[Array]:
    """Return the place in the lane, the times to its markings, and how far lanes are from where they could be.

    The latter is the distance from the nearest centre line of points beside the TV's lane and in it, some way ahead.
    aside: speed of the TV across its lane, m/s, (n,).
    """
    heading = motion.heading[:, :, -1]
    # Along the lane, which a vehicle that stands has, too.
    place = places(on_map, motion.position, heading)
    offset, width = place.offset_m, place.width_m
    left_m, right_m = (np.maximum(width / 2 - side * offset, 0.0) for side in (1, -1))
    columns = [offset, width, _time(left_m, aside), _time(right_m, -aside)]
    to_left = np.stack([-place.heading[:, 1], place.heading[:, 0]], axis=1)
    for side in (1, -1, 0):
        beside = motion.position + to_left * (side * width - offset)[:, None]
        columns += [np.abs(places(on_map, beside + heading * ahead, heading).offset_m) for ahead in AHEAD_M]
    return columns


def _to_uv(on_map: OnMap, motion: LaneMotion, speed: Array, acceleration: Array) -> list[Array]:
    """Return where the UV is and how it moves, seen from the TV, and how close a conflict with it is.

    speed, acceleration: of the TV along its lane, m/s and m/s2, (n,).
    """
    heading = motion.heading[:, :, -1]
    velocity, rate_hz = on_map.uv[:, 2:4], on_map.uv.shape[2] * on_map.tv_rate_hz / on_map.tv.shape[2]
    uv_along = _Ends(np.hypot(velocity[:, 0], velocity[:, 1]), rate_hz)
    uv_across = _Ends(heading[:, :1] * velocity[:, 1] - heading[:, 1:] * velocity[:, 0], rate_hz)
    apart = on_map.uv[:, :2, -1] - motion.position
    gap = np.einsum("nk,nk->n", heading, apart)
    uv_speed = uv_along.mean(0.0, INSTANT_S)
    accelerations = [uv_along.slope(age, ALONG_S) for age in ACROSS_AGES_S]
    room, closing = np.maximum(gap - VEHICLE_M, 0.5), speed - uv_speed
    stops_in = uv_speed**2 / 2 / np.maximum(-accelerations[0], 1.0)
    return [
        gap,
        heading[:, 0] * apart[:, 1] - heading[:, 1] * apart[:, 0],
        uv_speed,
        uv_along.mean(on_map.uv.shape[2] / rate_hz, INSTANT_S),
        *accelerations,
        closing,
        acceleration - accelerations[0],
        _time(room, speed),
        _time(room, closing),
        np.minimum(np.maximum(closing, 0.0) ** 2 / (2 * room), LARGEST_MPS2),
        np.minimum(speed**2 / 2 / np.maximum(room + stops_in, 1.0), LARGEST_MPS2),
        uv_across.mean(0.0, INSTANT_S),
        uv_across.mean(1.0, INSTANT_S),
        places(on_map, on_map.uv[:, :2, -1], velocity[:, :, -1]).offset_m,
    ]


def _time(distance_m: Array, speed_mps: Array) -> Array:
    """Return the time to cover a distance at a speed, s, at most LONGEST_S, also where the speed leads away, (n,)."""
    return np.minimum(distance_m / np.maximum(speed_mps, 1e-3), LONGEST_S)
