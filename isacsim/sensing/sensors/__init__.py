"""Sensors, by name: the one way to know a vehicle, in stored records, recordings and running traffic.

A sensor watches an episode, and is then asked about single vehicles, as whole records or piece by piece. It knows
nothing of labels, datasets or predictors. To add one, write a class that fulfils `protocol.Sensor`, and give it a line
below or, in a package of its own, an entry point of GROUP.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.sensing.passages import Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors.by_record import StoredPicture, StoredSensor
from isac_cosim.isacsim.sensing.sensors.isac import IsacSensor
from isac_cosim.isacsim.sensing.sensors.protocol import Picture, Sensor, SensorSettings
from isac_cosim.isacsim.sensing.sensors.radar import RadarSensor
from isac_cosim.isacsim.sensing.sensors.truth import TruthSensor

GROUP = "isac_cosim.sensors"
SENSORS: Registry[Sensor | StoredSensor] = Registry(
    "sensor",
    {
        "isac": IsacSensor(),
        "radar": RadarSensor(),
        "truth": TruthSensor(),
    },
    GROUP,
)
DEFAULT = "isac"
"""The sensor that datasets are generated with, and the one that is used where none is named."""


@dataclass(frozen=True)
class Watch:
    """A sensor at work on an episode. What its picture answers is checked, because it may be of another package.

    unusable: see `protocol.Sensor`.
    """

    name: str
    unusable: str
    picture: Picture

    def in_view(self, passage: Passage) -> BoolArray:
        """Return at which instants of a passage the sensor can follow the TV, (S,)."""
        return self.picture.in_view(passage)

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return what is known of each passage, in order. Raises InputError where the answers do not fit."""
        records = self.picture.record(passages)
        fit = len(records) == len(passages) and all(
            not record.usable or (record.state.shape == passage.truth.shape and np.isfinite(record.state).all())
            for record, passage in zip(records, passages, strict=True)
        )
        self._require(fit, "record")
        return records

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Go on by one piece of a world that runs. Raises InputError where the answer does not fit."""
        sensed = self.picture.step(piece, uv_of)
        shape = (len(sensed.names), *piece.tv.shape[1:])
        known = all(name in uv_of and name in piece.place for name in sensed.names)
        fit = not sensed.names or (sensed.state.shape == shape and bool(np.isfinite(sensed.state).all()))
        self._require(known and fit, "step")
        return sensed

    def _require(self, fit: bool, method: str) -> None:
        if not fit:
            raise InputError(
                f"sensor {self.name}: `{method}` returned no finite state of each vehicle at each instant that it was "
                "asked about; fix the sensor, or choose another"
            )


def watch(name: str, traffic: WatchedTraffic, settings: SensorSettings) -> Watch:
    """Let a sensor watch an episode. Raises InputError for an unknown one, or if it cannot sense the traffic so."""
    sensor = SENSORS[name]
    if isinstance(sensor, Sensor):
        return Watch(name, sensor.unusable, sensor.watch(traffic, settings))
    if isinstance(sensor, StoredSensor):
        return Watch(name, sensor.unusable, StoredPicture(traffic, sensor, settings))
    raise InputError(f"sensor {name}: is not one: it has neither `watch` nor `sense`; fix it, or choose another")
