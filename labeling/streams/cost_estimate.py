"""Estimates the size and cost of a dataset of streams, with constants measured on the bundled motorway.

A simulated second of it has 46 watched vehicle-seconds; other networks may have severalfold more or fewer. Sensing
takes 18 s of processor time for a vehicle-hour, and labelling an episode about as long as half of its simulation. A
scene is sensed as a whole, instant by instant: 140 s for 120 s of points, 280 for bodies (docs/scene.md).
"""

from __future__ import annotations

from dataclasses import dataclass

from isac_cosim.isacsim.traffic.sources.registry import motion_source, source_class
from isac_cosim.labeling.generation.settings import DatasetStudy

WATCHED = 46.0
"""Watched vehicles at a time."""
SENSED_S = 18.0
"""Processor time of sensing a vehicle-hour, s."""
SCENE_CPU_S = {"points": 0.047, "bodies": 0.093}
"""Processor time of sensing an instant of a scene, s, by what echoes of its vehicles."""
PREDICTED_S = 20.0
"""Processor time of predicting a vehicle-hour by a causal network and its baselines, s: 18 on the motorway."""
STATE_BYTES = 12.9
"""Bytes on disk per state of a TV or UV; a TV has two at each instant."""


@dataclass(frozen=True)
class StreamsCost:
    """The size and cost of a dataset of streams. cpu_s: processor time, s. bytes: size on disk."""

    episodes: int
    vehicle_hours: float
    cpu_s: float
    bytes: int

    @property
    def text(self) -> str:
        """One line for people."""
        return (
            f"{self.episodes} episodes: about {self.vehicle_hours:.0f} vehicle-hours if the traffic is that of the "
            f"bundled motorway, {self.bytes / 1e6:.0f} MB, {self.cpu_s / 60:.0f} min of processor time"
        )


def estimate(study: DatasetStudy) -> StreamsCost | None:
    """Estimate the cost of a study's streams; None where recordings have a length of their own."""
    duration = source_class(study.source).duration
    if duration is None:
        return None
    section, setting = duration
    duration_s = float(getattr(study.source_settings()[section], setting))
    episodes = len(study.seeds) * len(study.scenarios)
    hours = episodes * duration_s * WATCHED / 3600
    scene = study.sensing.scene
    instant_s = None if scene is None else scene.fixes_hz * SCENE_CPU_S[scene.bodies]
    sensing_s = hours * SENSED_S if instant_s is None else episodes * duration_s * instant_s
    cpu_s = episodes * 1.5 * motion_source(study).expected_cpu_s() + sensing_s
    states = 2 * study.record.tv_rate_hz + study.record.uv_rate_hz
    return StreamsCost(episodes, round(hours, 1), round(cpu_s, 1), round(hours * 3600 * states * STATE_BYTES))
