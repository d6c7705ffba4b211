"""What a sensor must do, and what it is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pydantic import Field, JsonValue

from isac_cosim.base.arrays import Array
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.chain import SensedRecord, SensingSettings
from isac_cosim.isacsim.sensing.onboard_radar import Carrier, RadarSettings


class SensorSettings(Settings):
    """Settings of all sensors; each reads the part that concerns it."""

    sensing: SensingSettings = Field(default_factory=SensingSettings, description="the sites' sensing chain")
    radar: RadarSettings = Field(default_factory=RadarSettings, description="the UV's own radar")
    options: dict[str, JsonValue] = Field(
        default_factory=dict, description="settings of an installed sensor, which checks them itself"
    )


@dataclass(frozen=True)
class StoredRecords:
    """B records as a dataset holds them; the other vehicles are not among it.

    truth: x, y, vx, vy, ax, ay of the TVs, m, m/s, m/s2, (B, 6, S) at rate_hz. keys: one for each record, which seeds
    its draws. sites: of the scenario. carrier: the UVs. past: true states of the TVs just before the records,
    (B, 6, P) at rate_hz, where the dataset holds them.
    """

    truth: Array
    rate_hz: float
    keys: Sequence[tuple[str | int, ...]]
    sites: Sequence[Site]
    carrier: Carrier
    past: Array | None = None


class Sensor(Protocol):
    """A way of knowing a TV's motion.

    label: a few words for tables and help texts. cost_s: processor time of one sensing instant of one record, s, for
    estimates. by_sites: whether the sites sense, so that the channel's SNR matters. filtered: whether fixes come
    before the states, so that their error is worth recording. unusable: why a record is left out that the sensor
    cannot follow, as the key under which such records are counted.

    A sensor is sent to worker processes, so its class has to be importable there. Every draw must be seeded by the
    record's key (`base.seeding.stream`), so that records do not depend on their company.
    """

    label: str
    cost_s: float
    by_sites: bool
    filtered: bool
    unusable: str

    def refusal(self, settings: SensorSettings) -> str | None:
        """Return in one line why stored records cannot be sensed like this, and the fix; None if they can."""

    def sense(self, records: StoredRecords, settings: SensorSettings) -> list[SensedRecord]:
        """Return what is known of each record, in order."""
