"""The rule of the road: what driver assistance would say of a window, from lane markings and thresholds alone.

A lane change is told by the time to line crossing: distance to the marking over lateral speed. Hard maneuvers are told
by the accelerations along and across the lane, an overtake by how soon the TV is level with a slower UV ahead of it.
Nothing is learned, unless the thresholds are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from pydantic import Field
from scipy.signal import savgol_filter
from sklearn.metrics import f1_score

from isacsim.arrays import Array, IntArray
from isacsim.errors import InputError
from isacsim.settings import Settings
from labeling.intentions import KNOWN, Intention
from models.data.lane_map import InLane
from models.data.windows import OnMap, Windows

LOOK_S = 0.2
"""Between the instants at which the lane's direction is looked up, about."""
LEAST = 1e-3
"""What distances and times are at least taken for, m or s, where something is divided by them."""
LEAST_STRENGTH = 1e-2
"""Below it nothing speaks for an intention."""
PARTS = ((slice(0, 2), 2), (slice(2, 4), 1))
"""Positions and velocities among the states, and the order of the polynomials that smooth them."""
STEPS = np.geomspace(0.4, 2.5, 15)
"""Factors that fitting tries on a threshold."""
FITTED = ("line_crossing_s", "brake_mps2", "accel_mps2", "swerve_mps2", "level_s")


class RuleSettings(Settings):
    """Thresholds of the rule; those of accelerations are the labels' own."""

    smooth_s: float = Field(0.5, gt=0, description="span of the straight-line fits that smooth velocities, s")
    line_crossing_s: float = Field(
        1.5,
        gt=0,
        description="time to line crossing that means a change, s; ISO 17361's earliest lane departure warning",
    )
    brake_mps2: float = Field(
        4.0, gt=0, description="deceleration of a hard brake, m/s2; UN R157: above 5 is emergency"
    )
    accel_mps2: float = Field(2.5, gt=0, description="acceleration of a hard acceleration, m/s2")
    swerve_mps2: float = Field(
        3.0, gt=0, description="lateral acceleration of a swerve, m/s2; UN R79 allows an automated lane change 1"
    )
    level_s: float = Field(
        30.0,
        gt=0,
        description="a left change is an overtake where the TV is level with the UV within this time, s; the labels "
        "give an overtake as long",
    )
    fit: bool = Field(False, description="scale the thresholds to the best macro-F1 on training windows")


@dataclass(frozen=True)
class Drive:
    """A batch of windows as the road sees them, each (n,).

    accel, brake, swerve: the greatest acceleration, deceleration and lateral acceleration in the window, m/s2. left,
    right: from the TV at the window's end to the markings of the lane it began the window in, m, negative when crossed.
    aside: its lateral speed at the end, m/s, left positive. level: until it is level with the UV, s, front bumpers;
    infinite where the UV is not ahead in that lane, or not slower.
    """

    accel: Array
    brake: Array
    swerve: Array
    left: Array
    right: Array
    aside: Array
    level: Array

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several batches as one."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def drive(windows: Windows, smooth_s: float) -> Drive:
    """What the rule looks at. InputError where the windows come without roads."""
    seen = windows.on_map
    if seen is None:
        raise InputError("the rule needs lane markings, and these windows come without roads: give it a dataset's")
    n_samples = seen.tv.shape[2]
    span = min(2 * int(smooth_s * seen.tv_rate_hz / 2) + 1, n_samples - (n_samples + 1) % 2)
    count = 2 + round(n_samples / (LOOK_S * seen.tv_rate_hz))
    look = np.unique(np.linspace(0, n_samples - 1, count).astype(np.int64))
    # Parabolas for positions: over half a second a bend is no straight line.
    smooth = np.concatenate([savgol_filter(seen.tv[:, part], span, order, axis=2) for part, order in PARTS], axis=1)
    way = _headings(seen, smooth, look)
    # Seen from the lane, a bend is no lateral acceleration: velocities are turned first, and differentiated then.
    along = np.einsum("nkt,nkt->nt", way, seen.tv[:, 2:4])
    across = way[:, 0] * seen.tv[:, 3] - way[:, 1] * seen.tv[:, 2]
    speed, aside = (savgol_filter(v, span, 1, axis=1) for v in (along, across))
    pull, push = (savgol_filter(v, span, 1, deriv=1, delta=1 / seen.tv_rate_hz, axis=1) for v in (along, across))
    began = _place(seen, smooth[:, :2, 0], smooth[:, 2:4, 0])
    moved = np.trapezoid(across, dx=1 / seen.tv_rate_hz, axis=1)
    offset, half = began.offset_m + moved, began.width_m / 2
    level = _until_level(seen, smooth[:, :2, -1], way[:, :, -1], speed[:, -1], offset, half)
    return Drive(
        pull.max(axis=1), -pull.min(axis=1), np.abs(push).max(axis=1), half - offset, half + offset, aside[:, -1], level
    )


def strengths(seen: Drive, settings: RuleSettings) -> Array:
    """How far each of the known intentions is on its way to its threshold, (n, 6).

    A lane change has at most 1, so that a hard maneuver beyond its threshold is told first. Of a left change and an
    overtake one has the whole strength, and the other less by how far `level` is on the wrong side of its threshold.
    """
    left = _crossing(seen.left, seen.aside, settings.line_crossing_s)
    right = _crossing(seen.right, -seen.aside, settings.line_crossing_s)
    soon = np.clip(settings.level_s / np.maximum(seen.level, LEAST), 0.5, 2.0)
    of: dict[Intention, Array] = {
        Intention.HARD_BRAKE: seen.brake / settings.brake_mps2,
        Intention.LEFT_LANE_CHANGE: left * np.minimum(1, 1 / soon),
        Intention.RIGHT_LANE_CHANGE: right,
        Intention.OVERTAKE: left * np.minimum(1, soon),
        Intention.HARD_ACCEL: seen.accel / settings.accel_mps2,
        Intention.EVASIVE_SWERVE: seen.swerve / settings.swerve_mps2,
    }
    return np.stack([of[intention] for intention in KNOWN], axis=1)


def logits(seen: Drive, settings: RuleSettings) -> Array:
    """Logarithms of the strengths, (n, 6): probabilities are the strengths' shares."""
    return np.log(np.maximum(strengths(seen, settings), LEAST_STRENGTH))


def fitted(seen: Drive, label: IntArray, settings: RuleSettings) -> RuleSettings:
    """The settings with every threshold scaled, one after the other and twice over, to the best macro-F1."""
    for name in FITTED * 2:
        tried = [settings.model_copy(update={name: float(getattr(settings, name) * step)}) for step in STEPS]
        scores = [_macro_f1(seen, label, each) for each in (settings, *tried)]
        settings = (settings, *tried)[int(np.argmax(scores))]
    return settings


def _macro_f1(seen: Drive, label: IntArray, settings: RuleSettings) -> float:
    return float(f1_score(label, logits(seen, settings).argmax(axis=1), average="macro"))


def _crossing(distance: Array, speed: Array, threshold_s: float) -> Array:
    """Strength of a change over a marking at that distance, m, neared at that speed, m/s; 1 once it is crossed."""
    on_the_way = threshold_s * np.maximum(speed, 0) / np.maximum(distance, LEAST)
    return np.where(distance <= 0, 1.0, np.minimum(on_the_way, 1.0))


def _headings(seen: OnMap, smooth: Array, look: IntArray) -> Array:
    """The lane's direction at every sample of the TV, unit vectors (n, 2, T), looked up at the samples `look`."""
    n, count = len(seen.tv), len(look)
    flat = np.moveaxis(smooth[:, :, look], 1, 2).reshape(n * count, 4)
    found = _place(seen, flat[:, :2], flat[:, 2:], repeat=count).heading.reshape(n, count, 2)
    angle = np.unwrap(np.arctan2(found[..., 1], found[..., 0]), axis=1)
    at = np.arange(smooth.shape[2])
    every = np.stack([np.interp(at, look, each) for each in angle])
    return np.stack([np.cos(every), np.sin(every)], axis=1)


def _place(seen: OnMap, position: Array, velocity: Array, repeat: int = 1) -> InLane:
    """Places (n repeat, 2) in the lanes of each window's own scenario, `repeat` of each window one after the other."""
    scenario = np.repeat(seen.scenario, repeat)
    offset, width, heading = np.empty(len(position)), np.empty(len(position)), np.empty((len(position), 2))
    for name in dict.fromkeys(seen.scenario.tolist()):
        rows = scenario == name
        found = seen.lane_maps(name).place(position[rows], velocity[rows])
        offset[rows], width[rows], heading[rows] = found.offset_m, found.width_m, found.heading
    return InLane(offset, width, heading)


def _until_level(seen: OnMap, position: Array, way: Array, speed: Array, offset: Array, half: Array) -> Array:
    """`Drive.level`, of TVs at positions (n, 2) in lanes of direction `way` (n, 2)."""
    velocity = seen.uv[:, 2:4, -1]
    ahead = _place(seen, seen.uv[:, :2, -1], velocity).heading
    # The chord between two points of a circular bend lies along the mean of the directions at both.
    chord = way + ahead
    chord /= np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)[:, None]
    apart = seen.uv[:, :2, -1] - position
    gap = np.einsum("nk,nk->n", chord, apart)
    aside = chord[:, 0] * apart[:, 1] - chord[:, 1] * apart[:, 0]
    closing = speed - np.einsum("nk,nk->n", ahead, velocity)
    meets = (gap > 0) & (closing > 0) & (np.abs(offset + aside) < half)
    return np.where(meets, gap / np.where(meets, closing, 1.0), np.inf)
