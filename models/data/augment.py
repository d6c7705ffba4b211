"""Augmentation of training windows: a turned frame, more noise, mirror images. All of it is off by default."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Windows

MIRRORED = {
    Intention.LEFT_LANE_CHANGE: Intention.RIGHT_LANE_CHANGE,
    Intention.RIGHT_LANE_CHANGE: Intention.LEFT_LANE_CHANGE,
}
"""Intentions that swap in the mirror image. The others stay; an overtake has none and is never mirrored."""


class AugmentSettings(Settings):
    """How training windows are augmented. Turning and mirroring need a frame of reference that is not absolute."""

    turn_deg: float = Field(0.0, ge=0, le=45, description="standard deviation of a turn of the frame")
    noise_m: float = Field(0.0, ge=0, le=1e3, description="standard deviation of noise on the TV's positions, m")
    noise_mps: float = Field(0.0, ge=0, le=1e3, description="standard deviation of noise on the TV's velocities, m/s")
    noise_mps2: float = Field(
        0.0, ge=0, le=1e3, description="standard deviation of noise on the TV's accelerations, m/s2"
    )
    mirror_share: float = Field(
        0.0,
        ge=0,
        le=1,
        description="share of windows that are mirrored, which swaps left and right changes; overtakes are never "
        "mirrored. Traffic that keeps right is not symmetric: mirrored windows are rare in it",
    )

    @property
    def turns_frame(self) -> bool:
        """Whether windows are turned or mirrored."""
        return self.turn_deg > 0 or self.mirror_share > 0


def augmented(
    windows: Windows, label: IntArray, settings: AugmentSettings, rng: np.random.Generator
) -> tuple[Windows, IntArray]:
    """Return augmented windows and their labels (n,), drawn from rng."""
    tv, uv = windows.tv, windows.uv
    if settings.mirror_share:
        chosen = (rng.random(len(label)) < settings.mirror_share) & (label != Intention.OVERTAKE)
        tv, uv = (np.where(chosen[:, None, None], mirrored(x), x) for x in (tv, uv))
        label = np.where(chosen, mirrored_labels(label), label)
    if settings.turn_deg:
        angle = np.radians(settings.turn_deg) * rng.normal(size=len(label))
        tv, uv = turned(tv, angle), turned(uv, angle)
    sd = np.repeat([settings.noise_m, settings.noise_mps, settings.noise_mps2], 2).astype(np.float32)
    if sd.any():
        tv = tv + sd[:, None] * rng.standard_normal(tv.shape, dtype=np.float32)
    return replace(windows, tv=tv, uv=uv, on_map=None), label


def mirrored(states: Float32Array) -> Float32Array:
    """Return states (n, 6, T) mirrored at the x axis, with left and right swapped."""
    return states * np.array([1, -1] * 3, dtype=np.float32)[:, None]


def mirrored_labels(label: IntArray) -> IntArray:
    """Return the labels (n,) of mirrored windows."""
    swapped = label.copy()
    for one, other in MIRRORED.items():
        swapped[label == one] = other
    return swapped


def turned(states: Float32Array, angle: Array) -> Float32Array:
    """Return states (n, 6, T) turned to the left about the origin by angles (n,), rad."""
    c, s = (f(angle).astype(np.float32)[:, None, None] for f in (np.cos, np.sin))
    pairs = states.reshape(len(states), 3, 2, -1)
    u, v = pairs[:, :, 0], pairs[:, :, 1]
    return np.stack([c * u - s * v, s * u + c * v], axis=2).reshape(states.shape)
