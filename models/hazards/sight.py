"""What a predictor may see of windows and streams, and what the lanes and the UV say of windows."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.models.data.lane_motion import LaneMotion
from isac_cosim.models.data.situation import FEATURES, situation
from isac_cosim.models.data.windows import OnMap, Windows, WindowSettings, in_frame
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.rule import IN_LANE, Drive, RuleSettings, drive_on, in_lane

N_SITUATION = IN_LANE + len(FEATURES)
"""Columns of `situation_of`."""


# Predictors that are measured side by side ask one after the other for the same of a batch.
@lru_cache(maxsize=2)
def drive_and_situation(on_map: OnMap) -> tuple[Drive, Array]:
    """Return what the rule of the road sees of windows, and that as features with their situation, (n, F)."""
    smooth_s = RuleSettings().smooth_s
    motion = LaneMotion.of(on_map, smooth_s)
    drive = drive_on(on_map, smooth_s, motion)
    features = np.concatenate([in_lane(drive), situation(on_map, motion)], axis=1)
    features.setflags(write=False)
    return drive, features


def situation_of(windows: Windows) -> Array:
    """Return the features of `drive_and_situation` of windows whose roads are known, (n, F); they are read-only."""
    on_map = windows.on_map
    assert on_map is not None, "windows of streams come with their roads"
    return drive_and_situation(on_map)[1]


def without_uv(windows: Windows, settings: WindowSettings, shape: WindowShape) -> Windows:
    """Return windows in which the TV takes the place of the UV, so that nothing is left of the UV's reports.

    Their roads must be known.
    """
    on_map = windows.on_map
    assert on_map is not None, "windows of streams come with their roads"
    uv = uv_for(on_map.tv, on_map.uv.shape[2], shape)
    windows = in_frame(on_map.tv, uv, settings, shape.tv_rate_hz, shape.uv_rate_hz)
    return replace(windows, on_map=replace(on_map, uv=uv))


def uv_for(tv: Array, length: int, shape: WindowShape) -> Array:
    """Return the TV's own states at the rate of the UV's reports, (n, 6, length), from those at its rate, (n, 6, T)."""
    ratio = shape.tv_rate_hz / shape.uv_rate_hz
    at = tv.shape[2] - 1 - np.rint(np.arange(length)[::-1] * ratio).astype(np.int64)
    return tv[:, :, np.maximum(at, 0)]


def samples_of(shape: WindowShape, step_s: float) -> tuple[int, int]:
    """Return the samples of the TV's and the UV's stream in a step. Raises InputError if they are not whole numbers."""
    samples = step_s * shape.tv_rate_hz, step_s * shape.uv_rate_hz
    if any(abs(number - round(number)) > 1e-6 or round(number) < 1 for number in samples):
        raise InputError(
            f"decisions every {step_s:g} s are not whole numbers of samples at {shape.tv_rate_hz:g} and "
            f"{shape.uv_rate_hz:g} Hz; a causal network needs that"
        )
    return round(samples[0]), round(samples[1])
