"""What the lanes and the UV say of windows: what the rule of the road sees, then the situation."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.models.data.lane_motion import LaneMotion
from isac_cosim.models.data.situation import FEATURES, situation
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.rule import IN_LANE, RuleSettings, drive_on, in_lane

N_SITUATION = IN_LANE + len(FEATURES)
"""Columns of `situation_of`."""


def situation_of(windows: Windows) -> Array:
    """Return what the lanes and the UV say of windows whose roads are known, (n, F)."""
    on_map = windows.on_map
    assert on_map is not None, "windows of streams come with their roads"
    smooth_s = RuleSettings().smooth_s
    motion = LaneMotion.of(on_map, smooth_s)
    return np.concatenate([in_lane(drive_on(on_map, smooth_s, motion)), situation(on_map, motion)], axis=1)
