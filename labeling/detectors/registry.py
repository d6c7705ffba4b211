"""The detectors by name."""

from __future__ import annotations

from isacsim.registry import Registry
from labeling.detectors.evasive_swerve import EvasiveSwerveDetector
from labeling.detectors.following import FollowingDetector
from labeling.detectors.hard_accel import HardAccelDetector
from labeling.detectors.hard_brake import HardBrakeDetector
from labeling.detectors.lane_change import LaneChangeDetector
from labeling.detectors.overtake import OvertakeDetector
from labeling.detectors.protocol import Detector

DETECTORS: Registry[type[Detector]] = Registry(
    "detector",
    {
        "lane_change": LaneChangeDetector,
        "overtake": OvertakeDetector,
        "hard_brake": HardBrakeDetector,
        "hard_accel": HardAccelDetector,
        "evasive_swerve": EvasiveSwerveDetector,
        "following": FollowingDetector,
    },
    "isac_cosim.detectors",
)
"""All detectors, in the order in which they run. The first six are the default definitions; see `Detector`."""
