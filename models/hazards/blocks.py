"""What a network that runs along a stream sees of each step: the last tenth of a second, in the TV's lane.

Each row depends on its own step alone, so that nothing is computed twice as windows move on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.models.data.lane_motion import places
from isac_cosim.models.data.windows import OnMap

AHEAD_M = 100.0
"""How far ahead lanes are looked up, m."""
LARGEST_M, LARGEST_S = 200.0, 20.0
"""Distances and times end here."""
LEAST_MPS = 1.0
"""A vehicle that is slower than this shows no direction."""
VEHICLE_M = 5.0
"""Length of a UV, m, because reports do not say it."""
FEATURES = (
    "along", "across", "acceleration", "across_acceleration", "along_slope", "across_slope",
    "offset", "to_left", "to_right",
    "left_lane", "right_lane", "ahead", "left_ahead", "right_ahead",
    "gap", "uv_aside", "uv_along", "uv_across", "uv_acceleration", "closing",
    "headway_s", "ttc_s", "needed", "uv_offset",
)  # fmt: skip
"""The names of the features, in m, m/s, m/s2 and s, positive to the left."""


def steps_of(on_map: OnMap, samples: tuple[int, int], sees_lanes: bool) -> Float32Array:
    """Return FEATURES of the steps of n windows, (n, K, F); the last step ends with the window.

    samples: of the TV's and of the UV's stream in a step. sees_lanes: whether the direction of the lane and where lanes
    are is known; otherwise the UV's motion gives the direction, or the TV's where the UV stands still.
    """
    tv, uv = _split(on_map.tv, samples[0]), _split(on_map.uv, samples[1])
    count = min(tv.shape[2], uv.shape[2])
    tv, uv = tv[:, :, -count:], uv[:, :, -count:]
    flat = tv.mean(axis=3).transpose(0, 2, 1).reshape(-1, 6)
    other = uv.mean(axis=3).transpose(0, 2, 1).reshape(-1, 6)
    slope = _slopes(tv[:, 2:4], on_map.tv_rate_hz).transpose(0, 2, 1).reshape(-1, 2)
    if sees_lanes:
        place = places(on_map, flat[:, :2], flat[:, 2:4], count)
        heading, offset, width = place.heading, place.offset_m, place.width_m
    else:
        heading, offset, width = _heading(flat[:, 2:4], other[:, 2:4]), np.zeros(len(flat)), np.zeros(len(flat))
    left = np.stack([-heading[:, 1], heading[:, 0]], axis=1)

    def turned(vectors: Array) -> tuple[Array, Array]:
        return np.einsum("nk,nk->n", heading, vectors), np.einsum("nk,nk->n", left, vectors)

    along, across = turned(flat[:, 2:4])
    gap, aside = turned(other[:, :2] - flat[:, :2])
    uv_along, uv_across = turned(other[:, 2:4])
    room, closing = np.maximum(gap - VEHICLE_M, 0.5), along - uv_along
    columns = [along, across, *turned(flat[:, 4:6]), *turned(slope), offset, width / 2 - offset, width / 2 + offset]
    uv_offset = np.zeros(len(flat))
    if sees_lanes:
        asked = [
            flat[:, :2] + left * (side * width - offset)[:, None] + heading * ahead_m
            for side, ahead_m in ((1, 0.0), (-1, 0.0), (0, AHEAD_M), (1, AHEAD_M), (-1, AHEAD_M))
        ]
        # All places at once: a look at the map takes long for few of them.
        of_all = replace(on_map, scenario=np.tile(on_map.scenario, len(asked) + 1))
        # Lanes beside and ahead lead along the TV's, which it has even where it stands.
        ways = np.concatenate([*[heading] * len(asked), other[:, 2:4]])
        offsets = places(of_all, np.concatenate([*asked, other[:, :2]]), ways, count).offset_m
        *beside, of_uv = offsets.reshape(len(asked) + 1, -1)
        columns += [np.minimum(np.abs(away), LARGEST_M) for away in beside]
        uv_offset = np.clip(of_uv, -LARGEST_M, LARGEST_M)
    else:
        columns += [np.zeros(len(flat))] * 5
    columns += [
        np.clip(gap, -LARGEST_M, LARGEST_M),
        np.clip(aside, -LARGEST_M, LARGEST_M),
        uv_along,
        uv_across,
        turned(other[:, 4:6])[0],
        closing,
        np.minimum(room / np.maximum(along, LEAST_MPS), LARGEST_S),
        np.minimum(room / np.maximum(closing, 1e-3), LARGEST_S),
        np.minimum(np.maximum(closing, 0.0) ** 2 / (2 * room), 20.0),
        uv_offset,
    ]
    return np.stack(columns, axis=1).reshape(len(tv), count, -1).astype(np.float32)


def _split(states: Array, samples: int) -> Array:
    """Return streams (n, c, T) as whole steps, the last of which ends with the stream, (n, c, K, samples)."""
    count = states.shape[2] // samples
    return states[:, :, states.shape[2] - count * samples :].reshape(*states.shape[:2], count, samples)


def _slopes(values: Array, rate_hz: float) -> Array:
    """Return the least-squares slope within each step, per second, (n, c, K); 0 for steps of one sample."""
    if values.shape[3] < 2:
        return np.zeros(values.shape[:3])
    time_s = (np.arange(values.shape[3]) - (values.shape[3] - 1) / 2) / rate_hz
    return np.asarray(values @ time_s / (time_s @ time_s))


def _heading(tv: Array, uv: Array) -> Array:
    """Return unit vectors along the UV's velocity, or the TV's where the UV stands still, (n, 2)."""
    speeds = [np.hypot(velocity[:, 0], velocity[:, 1])[:, None] for velocity in (uv, tv)]
    chosen = np.where(speeds[0] >= LEAST_MPS, uv, tv)
    norm = np.where(speeds[0] >= LEAST_MPS, speeds[0], speeds[1])
    return np.where(norm > 1e-6, chosen / np.maximum(norm, 1e-6), np.array([1.0, 0.0]))
