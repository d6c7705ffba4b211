"""Sensors that sense one record after the other, and have no more to say about an episode than that.

`RecordPicture` follows a TV through streams and running traffic by sensing record after record. `StoredSensor` is the
form that sensors had before they could watch an episode: it is given stored records and nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.passages import (
    NOTHING,
    Carrier,
    Passage,
    Piece,
    SensedPiece,
    SensedRecord,
    WatchedTraffic,
)
from isac_cosim.isacsim.sensing.sensors.protocol import Described, SensorSettings

PAST_S = 5.0
"""How much of a TV's motion before a piece is kept, s: the longest run-in of a filter."""


class RecordPicture(ABC):
    """A picture that needs nothing but `record`. In running traffic, each piece is a record whose past is known."""

    def __init__(self, traffic: WatchedTraffic) -> None:
        self.traffic = traffic
        self._past: dict[str, Array] = {}

    @abstractmethod
    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return what is known of each passage, in order."""

    def in_view(self, passage: Passage) -> BoolArray:
        """Everywhere, as far as can be known beforehand."""
        return np.ones(passage.truth.shape[1], dtype=bool)

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Sense the TVs over a piece. The random draws of two pieces are independent."""
        passages = [self._passage(piece, name, uv_of[name]) for name in piece.names if name in uv_of]
        usable = [
            (passage, record.state)
            for passage, record in zip(passages, self.record(passages), strict=True)
            if record.usable
        ]
        most = round(PAST_S * self.traffic.rate_hz)
        self._past = {
            passage.tv: passage.truth
            if passage.past is None
            else np.concatenate([passage.past, passage.truth], axis=1)[:, -most:]
            for passage, _ in usable
        }
        names = tuple(passage.tv for passage, _ in usable)
        return SensedPiece(names, np.stack([state for _, state in usable])) if usable else NOTHING

    def _passage(self, piece: Piece, tv: str, uv: str) -> Passage:
        traffic, truth = self.traffic, piece.tv[piece.place[tv]]

        def find_carrier() -> Carrier | None:
            if uv not in piece.place:
                return None
            report, state = traffic.report, piece.tv[piece.place[uv]]
            sd = report.position_sd_m, report.speed_sd_mps
            return Carrier(state, traffic.rate_hz, None, *sd, vehicles=(uv,))

        key = ("live", traffic.scenario, traffic.seed, tv, f"{piece.end_s:.6f}")
        start_s = piece.end_s - (truth.shape[1] - 1) / traffic.rate_hz
        return Passage(tv, start_s, truth, key, self._past.get(tv), find_carrier=find_carrier)


@dataclass(frozen=True)
class StoredRecords:
    """B records as a dataset holds them; the other vehicles are not among it.

    truth: x, y, vx, vy, ax, ay of the TVs, m, m/s, m/s2, (B, 6, S) at rate_hz. keys: one for each record, which seeds
    its draws. sites: of the scenario. carrier: the UVs, with states (B, 6, C); None where there are none. past: true
    states of the TVs just before the records, (B, 6, P) at rate_hz, where they are known.
    """

    truth: Array
    rate_hz: float
    keys: Sequence[tuple[str | int, ...]]
    sites: Sequence[Site]
    carrier: Carrier | None
    past: Array | None = None


@runtime_checkable
class StoredSensor(Described, Protocol):
    """A sensor that senses stored records, and knows no more of an episode."""

    def sense(self, records: StoredRecords, settings: SensorSettings) -> list[SensedRecord]:
        """Return what is known of each record, in order; records do not depend on their company."""


class StoredPicture(RecordPicture):
    """What a `StoredSensor` knows: it is asked about one passage after the other."""

    def __init__(self, traffic: WatchedTraffic, sensor: StoredSensor, settings: SensorSettings) -> None:
        super().__init__(traffic)
        self._sensor, self._settings = sensor, settings

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Sense passages as stored records."""
        return [record for passage in passages for record in self._sensed(passage)]

    def _sensed(self, passage: Passage) -> list[SensedRecord]:
        traffic, carrier, past = self.traffic, passage.carrier, passage.past
        if carrier is not None:
            reported = None if carrier.reported is None else carrier.reported[None]
            carrier = replace(carrier, state=carrier.state[None], reported=reported)
        past = None if past is None else past[None]
        truth, keys = passage.truth[None], [passage.key]
        records = StoredRecords(truth, traffic.rate_hz, keys, traffic.sites, carrier, past)
        return self._sensor.sense(records, self._settings)
