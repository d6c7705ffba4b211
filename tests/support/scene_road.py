"""A short recording of a straight road with vehicles that a test drives, for scenes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isac_cosim.isacsim.radio.channel import ChannelSettings
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.scene.settings import SceneSettings, SceneSetup
from isac_cosim.isacsim.tracking.kalman import TrackingSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

STEP_S, LANE_M, LENGTH_M = 0.01, 3.2, 900.0
LANES = tuple(
    Lane(f"e_{k}", "e", k, LANE_M, LENGTH_M, np.array([[0.0, LANE_M * k], [LENGTH_M, LANE_M * k]]), ())
    for k in range(3)
)
SITES = tuple(
    Site(f"s{k}-{azimuth}", 150.0 * k + 50.0, 20.0 if k % 2 else -20.0, 15.0, azimuth)
    for k in range(6)
    for azimuth in ((135.0, 225.0) if k % 2 else (45.0, 315.0))
)
"""Masts on alternating sides, each with two panels toward the road."""


def recording(driven: Mapping[str, tuple[float, float, int]], seconds: float, first_s: float = 0.0) -> Recording:
    """Vehicles at constant speed. driven: where each begins, m, its speed, m/s, and its lane."""
    t = np.arange(0.0, seconds, STEP_S)
    tracks = {}
    for name, (start, speed, lane) in driven.items():
        x, zero = start + speed * t, np.zeros_like(t)
        of_lane, first_step = np.full(len(t), lane), round(first_s / STEP_S)
        tracks[name] = Track(
            name, "passenger", 4.5, 1.8, first_step, x, zero + LANE_M * lane, zero + speed, of_lane, x, zero
        )
    return Recording("road", 1, STEP_S, LANES, tracks)


def setup(**scene: object) -> SceneSetup:
    """Return what a scene depends on, with some of its settings; vehicles are points unless these say otherwise."""
    return SceneSetup(
        SceneSettings.model_validate({"bodies": "points", **scene}),
        ChannelSettings(kind="link"),
        TrackingSettings(),
        MotionSettings(),
    )
