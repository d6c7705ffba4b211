"""Sensors, by name: the one way to know a vehicle, in stored records, recordings and running traffic.

In come the true motion of an episode and who is asked about; out come states as the sensor knows them.

A sensor watches an episode, and is then asked about single vehicles, as whole records or piece by piece. It knows
nothing of labels, datasets or predictors. To add one, write a class that fulfils `protocol.Sensor`, and give it a line
below or, in a package of its own, an entry point of GROUP.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.sensing.passages import Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors.by_record import StoredPicture, StoredSensor
from isac_cosim.isacsim.sensing.sensors.isac import IsacSensor
from isac_cosim.isacsim.sensing.sensors.protocol import Picture, Sensor, SensorSettings
from isac_cosim.isacsim.sensing.sensors.radar import RadarSensor
from isac_cosim.isacsim.sensing.sensors.scene import ScenePicture, SceneSensor
from isac_cosim.isacsim.sensing.sensors.truth import TruthSensor

GROUP = "isac_cosim.sensors"
SCENE = "scene"
"""The sensor of studies whose sites sense all vehicles at once."""
SENSORS: Registry[Sensor | StoredSensor] = Registry(
    "sensor",
    {
        "isac": IsacSensor(),
        "radar": RadarSensor(),
        SCENE: SceneSensor(),
        "truth": TruthSensor(),
    },
    GROUP,
)
DEFAULT = "isac"
"""The sensor that datasets are generated with, and the one that is used where none is named."""


@dataclass(frozen=True)
class Watch:
    """A sensor at work on an episode. What its picture answers is checked, because it may be of another package.

    unusable: see `protocol.Described`.
    """

    name: str
    unusable: str
    picture: Picture

    @property
    def scene_scores(self) -> SceneScores | None:
        """How well the network knows who is where; None of sensors that watch single vehicles."""
        return self.picture.scores if isinstance(self.picture, ScenePicture) else None

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return what is known of each passage, in order. Raises InputError where the answers do not fit."""
        records = self.picture.record(passages)
        states = [
            (record.state, passage.truth) for record, passage in zip(records, passages, strict=False) if record.usable
        ]
        self._require(len(records) == len(passages) and all(_fits(state, truth.shape) for state, truth in states))
        return records

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Go on by one piece of a world that runs. Raises InputError where the answer does not fit."""
        sensed = self.picture.step(piece, uv_of)
        asked = all(name in uv_of and name in piece.place for name in sensed.names)
        shape = (len(sensed.names), *piece.tv.shape[1:])
        self._require(asked and (not sensed.names or _fits(sensed.state, shape)))
        return sensed

    def _require(self, fit: bool) -> None:
        if not fit:
            raise InputError(
                f"sensor {self.name}: returned no finite state of each vehicle at each instant that it was asked "
                "about; fix the sensor, or choose another"
            )


def _fits(state: Array, shape: tuple[int, ...]) -> bool:
    return state.shape == shape and bool(np.isfinite(state).all())


def watch(name: str, traffic: WatchedTraffic, settings: SensorSettings) -> Watch:
    """Let a sensor watch an episode. Raises InputError for an unknown one, or if it cannot sense the traffic so."""
    sensor = SENSORS[name]
    if isinstance(sensor, Sensor):
        return Watch(name, sensor.unusable, sensor.watch(traffic, settings))
    if isinstance(sensor, StoredSensor):
        return Watch(name, sensor.unusable, StoredPicture(traffic, sensor, settings))
    raise InputError(
        f"sensor {name}: is not one: it lacks a method or an attribute of `isacsim.sensing.sensors.protocol.Sensor`; "
        "fix it, or choose another"
    )
