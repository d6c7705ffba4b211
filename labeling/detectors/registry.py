"""The detectors by name."""

from __future__ import annotations

from isac_cosim.base.registry import Registry
from isac_cosim.labeling.detectors.evasive_swerve import EvasiveSwerveDetector
from isac_cosim.labeling.detectors.following import FollowingDetector
from isac_cosim.labeling.detectors.hard_accel import HardAccelDetector
from isac_cosim.labeling.detectors.hard_brake import HardBrakeDetector
from isac_cosim.labeling.detectors.lane_change import LaneChangeDetector
from isac_cosim.labeling.detectors.overtake import OvertakeDetector
from isac_cosim.labeling.detectors.protocol import Detector

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
