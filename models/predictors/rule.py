"""The rule of the road: what driver assistance would conclude from a window, by lane markings and thresholds alone.

A lane change is recognised by the time to line crossing: distance to the marking over lateral speed. Hard maneuvers are
recognised by the accelerations along and across the lane, an overtake by how soon the TV is level with a slower UV
ahead of it. Nothing is learned, unless the thresholds are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.lane_motion import LaneMotion, places, slopes, smoothed
from isac_cosim.models.data.windows import OnMap, Windows
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor, WindowShape

RULE_FILE = "rule.json"
LEAST = 1e-3
"""Distances and times are raised to this value before they divide anything, m or s."""
LONGEST_S = 60.0
"""Times until a TV is level with the UV end here where they are features, s."""
LEAST_STRENGTH = 1e-2
"""Strengths are raised to this value before their logarithm is taken."""
FACTORS = np.geomspace(0.4, 2.5, 15)
"""Factors by which fitting tries to scale a threshold."""
IN_LANE = 7 + len(KNOWN)
"""Columns of `in_lane`."""
FITTED = ("line_crossing_s", "brake_mps2", "accel_mps2", "swerve_mps2", "level_s")
"""The thresholds that fitting scales."""


class RuleSettings(Settings):
    """Thresholds of the rule; those of the accelerations are the ones that define the labels."""

    smooth_s: float = Field(0.5, gt=0, le=1e3, description="span of the straight-line fits that smooth velocities, s")
    line_crossing_s: float = Field(
        1.5,
        gt=0,
        le=1e3,
        description="time to line crossing that means a lane change, s; the earliest lane departure warning of "
        "ISO 17361",
    )
    brake_mps2: float = Field(
        4.0, gt=0, le=1e3, description="deceleration of a hard brake, m/s2; in UN R157, above 5 is emergency"
    )
    accel_mps2: float = Field(2.5, gt=0, le=1e3, description="acceleration of a hard acceleration, m/s2")
    swerve_mps2: float = Field(
        3.0,
        gt=0,
        le=1e3,
        description="lateral acceleration of a swerve, m/s2; UN R79 allows 1 in an automated lane change",
    )
    level_s: float = Field(
        30.0,
        gt=0,
        le=1e3,
        description="a change to the faster side is an overtake if the TV is level with the UV within this time, s; "
        "the labels allow an overtake as long",
    )
    fit: bool = Field(False, description="scale the thresholds to the best macro-F1 on the training windows")


class RulePredictor(Predictor):
    """The rule with its thresholds; its features are its logits."""

    display_name = "rule of the road"
    summary = "thresholds on lane markings and accelerations; nothing is learned unless they are fitted"
    settings_class: ClassVar[type[Settings] | None] = RuleSettings

    def __init__(self, settings: RuleSettings) -> None:
        self.settings = settings

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        settings = task.settings.of(RuleSettings)
        if not settings.fit:
            return cls(settings)
        ends, label = task.training_ends(task.settings.ends_per_record)
        drives = Drive.joined([drive(windows, settings.smooth_s) for windows in task.batches(ends)])
        return cls(fitted(drives, label, settings))

    def save(self, folder: Path) -> None:
        content = self.settings.model_dump_json(indent=1) + "\n"
        replace_file(folder / RULE_FILE, lambda path: path.write_text(content))

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        stored = read_json(RuleSettings, folder / RULE_FILE)
        if stored is None:
            raise FileNotFoundError(f"{RULE_FILE}: is missing")
        return cls(stored)

    def __call__(self, windows: Windows) -> Outputs:
        answer = logits(drive(windows, self.settings.smooth_s), self.settings)
        return Outputs(answer, answer)


@dataclass(frozen=True)
class Drive:
    """What the rule sees of a batch of windows, each array (n,).

    accel, brake, swerve: greatest acceleration, deceleration and lateral acceleration in the window, m/s2. left, right:
    distances at the end of the window from the TV to the markings of the lane in which it began the window, m, negative
    once crossed. aside: its lateral speed at the end, m/s, positive to the left. level: time until it is level with the
    UV, s, from front bumper to front bumper; infinite if the UV is not ahead in that lane, or not slower. lefthand:
    whether traffic keeps left and overtakes on the right.
    """

    accel: Array
    brake: Array
    swerve: Array
    left: Array
    right: Array
    aside: Array
    level: Array
    lefthand: BoolArray

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return several batches as one."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def drive(windows: Windows, smooth_s: float) -> Drive:
    """Return what the rule sees of n windows. Raises InputError if the windows come without roads.

    smooth_s: span of the smoothing fits, s.
    """
    on_map = windows.on_map
    if on_map is None:
        raise InputError("the rule needs lane markings, but these windows come without roads: use those of a dataset")
    return drive_on(on_map, smooth_s)


def drive_on(on_map: OnMap, smooth_s: float, motion: LaneMotion | None = None) -> Drive:
    """Return what the rule sees of n windows whose roads are known.

    smooth_s: span of the smoothing fits, s. motion: relative to the lanes, where it is known already.
    """
    motion = motion or LaneMotion.of(on_map, smooth_s)
    span, last = motion.span, on_map.tv.shape[2] - 1
    speed, aside = (smoothed(v, span, 1, (last,))[:, 0] for v in (motion.along, motion.across))
    accel, swerve = (slopes(v, span) * on_map.tv_rate_hz for v in (motion.along, motion.across))
    offset, half = motion.offset_m, motion.width_m / 2
    level = _until_level(on_map, motion.position, motion.heading[:, :, -1], speed, offset, half)
    return Drive(
        accel=accel.max(axis=1),
        brake=-accel.min(axis=1),
        swerve=np.abs(swerve).max(axis=1),
        left=half - offset,
        right=half + offset,
        aside=aside,
        level=level,
        lefthand=np.array([on_map.lane_maps(name).lefthand for name in on_map.scenario.tolist()], dtype=bool),
    )


def in_lane(drives: Drive) -> Array:
    """Return what the rule makes of n windows, as features for other predictors, (n, 13).

    Greatest acceleration, deceleration and lateral acceleration (m/s2), distances to the left and the right marking
    (m), lateral speed (m/s), time until level with the UV (s), and the logits of the rule with its default thresholds.
    """
    level = np.minimum(drives.level, LONGEST_S)
    motion = drives.accel, drives.brake, drives.swerve, drives.left, drives.right, drives.aside
    return np.concatenate([np.stack([*motion, level], axis=1), logits(drives, RuleSettings())], axis=1)


def strengths(drives: Drive, settings: RuleSettings) -> Array:
    """Return how far each known intention is on the way to its threshold, (n, 6); 1 is at the threshold.

    A lane change has at most 1, so that a hard maneuver beyond its threshold wins. Overtakes begin with a change to the
    faster side: the left, or the right where traffic keeps left. Of that change and an overtake, one has the whole
    strength, and the other less by the factor by which `level` is on the wrong side of its threshold.
    """
    left = _crossing(drives.left, drives.aside, settings.line_crossing_s)
    right = _crossing(drives.right, -drives.aside, settings.line_crossing_s)
    soon = np.clip(settings.level_s / np.maximum(drives.level, LEAST), 0.5, 2.0)
    no_overtake = np.minimum(1, 1 / soon)
    by_intention: dict[Intention, Array] = {
        Intention.HARD_BRAKE: drives.brake / settings.brake_mps2,
        Intention.LEFT_LANE_CHANGE: np.where(drives.lefthand, left, left * no_overtake),
        Intention.RIGHT_LANE_CHANGE: np.where(drives.lefthand, right * no_overtake, right),
        Intention.OVERTAKE: np.where(drives.lefthand, right, left) * np.minimum(1, soon),
        Intention.HARD_ACCEL: drives.accel / settings.accel_mps2,
        Intention.EVASIVE_SWERVE: drives.swerve / settings.swerve_mps2,
    }
    return np.stack([by_intention[intention] for intention in KNOWN], axis=1)


def logits(drives: Drive, settings: RuleSettings) -> Array:
    """Return the logarithms of the strengths, (n, 6); probabilities are then the shares of the strengths."""
    return np.log(np.maximum(strengths(drives, settings), LEAST_STRENGTH))


def fitted(drives: Drive, label: IntArray, settings: RuleSettings) -> RuleSettings:
    """Return the settings with each threshold scaled in turn, twice over, to the best macro-F1 on labels (n,)."""
    for name in FITTED * 2:
        scaled = [settings.model_copy(update={name: float(getattr(settings, name) * factor)}) for factor in FACTORS]
        candidates = (settings, *scaled)
        settings = candidates[int(np.argmax([_macro_f1(drives, label, candidate) for candidate in candidates]))]
    return settings


def _macro_f1(drives: Drive, label: IntArray, settings: RuleSettings) -> float:
    from sklearn.metrics import f1_score  # loaded only here, because it takes long

    return float(f1_score(label, logits(drives, settings).argmax(axis=1), average="macro"))


def _crossing(distance: Array, speed: Array, threshold_s: float) -> Array:
    """Return the strength of a lane change across a marking, (n,).

    distance: to the marking, m. speed: towards it, m/s. The strength is the threshold over the time to line crossing,
    at most 1, and 1 once the marking is crossed.
    """
    approaching = threshold_s * np.maximum(speed, 0) / np.maximum(distance, LEAST)
    return np.where(distance <= 0, 1.0, np.minimum(approaching, 1.0))


def _until_level(on_map: OnMap, position: Array, heading: Array, speed: Array, offset: Array, half: Array) -> Array:
    """Return `Drive.level`, (n,).

    position: of the TV, (n, 2). heading: of its lane, unit vectors (n, 2). speed: of the TV along the lane, m/s.
    offset: of the TV from the centre line, m. half: half the width of the lane, m.
    """
    velocity = on_map.uv[:, 2:4, -1]
    uv_heading = places(on_map, on_map.uv[:, :2, -1], velocity).heading
    # The chord between two points of a circular bend has the mean of the directions at both.
    chord = heading + uv_heading
    chord /= np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)[:, None]
    apart = on_map.uv[:, :2, -1] - position
    gap = np.einsum("nk,nk->n", chord, apart)
    aside = chord[:, 0] * apart[:, 1] - chord[:, 1] * apart[:, 0]
    closing = speed - np.einsum("nk,nk->n", uv_heading, velocity)
    meets = (gap > 0) & (closing > 0) & (np.abs(offset + aside) < half)
    return np.where(meets, gap / np.where(meets, closing, 1.0), np.inf)
