"""What a sensor must do, and what it is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from pydantic import Field, JsonValue

from isac_cosim.base.arrays import BoolArray
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.onboard_radar import RadarSettings
from isac_cosim.isacsim.sensing.passages import Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic


class SensorSettings(Settings):
    """Settings of all sensors; each reads the part that concerns it."""

    sensing: SensingSettings = Field(default_factory=SensingSettings, description="the sites' sensing chain")
    radar: RadarSettings = Field(default_factory=RadarSettings, description="the UV's own radar")
    options: dict[str, JsonValue] = Field(
        default_factory=dict, description="settings of an installed sensor, which checks them itself"
    )


class Picture(Protocol):
    """What a sensor knows of one episode. It may keep what it needs from call to call; it stays in its process.

    `isacsim.sensing.sensors.by_record.RecordPicture` is one that needs nothing but `record`.
    """

    def in_view(self, passage: Passage) -> BoolArray:
        """Return at which instants the sensor can follow the TV, (S,). Streams are cut into parts where it can."""

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return what is known of each passage, in order: of stored records, or of stretches of the recording.

        A sensor that senses vehicles one by one seeds each draw by the passage's key (`base.seeding.stream`), so that
        records do not depend on their company.
        """

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Go on by one piece of a world that runs; pieces come in order, without gaps.

        uv_of: the TVs to follow, each with the UV that is ahead of it. A TV that is not returned for a piece begins
        anew when it comes back. Draws are seeded by the scenario, the seed, the vehicle and the time.
        """


class Described(Protocol):
    """What is said of every sensor.

    label: a few words for tables and help texts. cost_s: processor time of one sensing instant of one record, s, for
    estimates. by_sites: whether the sites sense, so that the channel's SNR matters. filtered: whether fixes come
    before the states, so that their error is worth recording. unusable: why a record is left out that the sensor
    cannot follow, as the key under which such records are counted.
    """

    label: str
    cost_s: float
    by_sites: bool
    filtered: bool
    unusable: str

    def refusal(self, settings: SensorSettings) -> str | None:
        """Return in one line why stored records cannot be sensed like this, and the fix; None if they can."""


@runtime_checkable
class Sensor(Described, Protocol):
    """A way of knowing the motion of TVs. It is sent to worker processes, so its class has to be importable there."""

    def watch(self, traffic: WatchedTraffic, settings: SensorSettings) -> Picture:
        """Watch an episode: called once, before anything is asked about it.

        A sensor that senses all vehicles together does so here, where the recording is at hand.
        Raises InputError if the traffic cannot be sensed with these settings.
        """
