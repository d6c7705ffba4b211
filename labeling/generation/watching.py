"""Which sensor watches an episode of a study: that of its dataset, of its streams, or of an arm of the closed loop."""

from __future__ import annotations

from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.passages import WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import DEFAULT, SCENE, Watch, watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy


def watch_episode(
    study: DatasetStudy,
    scenario: Scenario,
    seed: int,
    recording: Recording | None = None,
    sensor: str = DEFAULT,
    settings: SensorSettings | None = None,
) -> Watch:
    """Let a sensor watch an episode of a study. recording: of the episode; None while it runs.

    sensor: the sites, unless another one is named; they sense a scene where the study says so.
    settings: of the sensor; the default are those of the study. Raises InputError if it cannot sense the traffic.
    """
    rate_hz = study.record.tv_rate_hz
    traffic = WatchedTraffic(scenario.name, seed, scenario.sites, rate_hz, study.report, recording, study.motion)
    if sensor == DEFAULT and study.sensing.scene is not None:
        sensor = SCENE
    return watch(sensor, traffic, settings or SensorSettings(sensing=study.sensing))
