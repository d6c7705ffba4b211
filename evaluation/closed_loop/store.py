"""One arm of one seed on disk: what every vehicle did, the alarms, and the advisories."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.episode_files import EpisodeFiles, named_column, names_and_numbers
from isac_cosim.base.stored.tables import check_types
from isac_cosim.evaluation.closed_loop.safety import Encroachments, VehicleMotions
from isac_cosim.evaluation.closed_loop.settings import Arm
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording

NUMBERS = ("time_s", "x", "y", "speed", "acceleration", "ttc_s", "drac_mps2")
"""The numeric columns of a file, as in `VehicleMotions`."""
MAY_BE_INFINITE = ("ttc_s",)
"""Those of them that are infinite where there is nothing to collide with."""


class AlarmFacts(Settings):
    """An alarm. time_s: of the sensed world's clock. raised_s: of the simulation's. x, y: of the TV at time_s, m."""

    tv: str
    intention: str
    time_s: float
    raised_s: float
    x: float
    y: float


class AdvisoryFacts(Settings):
    """An advisory. time_s: when it was sent, s of simulation time. fate: what became of it (`Advisor`).

    begun_s: when the vehicle began to follow it; None if it did not.
    """

    vehicle: str
    instruction: str
    time_s: float
    fate: str
    begun_s: float | None


class EncroachmentFacts(Settings):
    """A vehicle passed a place soon before another one (`Encroachments`)."""

    entering: str
    behind: str
    time_s: float
    pet_s: float
    crossing: bool


class ArmFacts(Settings):
    """What an arm's file says beside the driving.

    fingerprint: of the evaluation. traffic: digest of every state of the recording. predicted_hours: for which vehicles
    were predicted. vehicles: on the road, without those that collided or teleported, which have no states.
    """

    schema_version: Literal[3] = 3
    fingerprint: str
    scenario: str
    seed: int
    arm: Arm
    traffic: str
    vehicles: int = Field(ge=0)
    collided: tuple[str, ...]
    teleported: tuple[str, ...]
    predicted_hours: float = Field(ge=0)
    every_s: float = Field(gt=0)
    alarms: tuple[AlarmFacts, ...]
    advisories: tuple[AdvisoryFacts, ...]
    encroachments: tuple[EncroachmentFacts, ...]


@dataclass(frozen=True)
class ArmEpisode:
    """One arm of one seed."""

    facts: ArmFacts
    driving: VehicleMotions

    @property
    def encroachments(self) -> Encroachments:
        """The entries into lanes ahead of others, and the crossings of paths."""
        stored = self.facts.encroachments
        return Encroachments(
            tuple(one.entering for one in stored),
            tuple(one.behind for one in stored),
            np.array([one.time_s for one in stored], dtype=np.float64),
            np.array([one.pet_s for one in stored], dtype=np.float64),
            np.array([one.crossing for one in stored], dtype=bool),
        )


def encroachment_facts(encroachments: Encroachments) -> tuple[EncroachmentFacts, ...]:
    """Return encroachments as they are stored."""
    times, pets = np.round(encroachments.time_s, 6).tolist(), np.round(encroachments.pet_s, 6).tolist()
    names, crossing = (encroachments.entering, encroachments.behind), encroachments.crossing.tolist()
    return tuple(
        EncroachmentFacts(entering=entering, behind=behind, time_s=time_s, pet_s=pet_s, crossing=crosses)
        for entering, behind, time_s, pet_s, crosses in zip(*names, times, pets, crossing, strict=True)
    )


def digest_of(recording: Recording) -> str:
    """Return the digest of all states of a recording: equal traffic, to the last bit, has equal digests."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(recording.tracks):
        track = recording.tracks[name]
        digest.update(f"{name} {track.first_step} {len(track)}".encode())
        for column in COLUMNS:
            digest.update(np.ascontiguousarray(getattr(track, column)).tobytes())
    digest.update(repr((recording.incidents.collided, recording.incidents.teleported)).encode())
    return digest.hexdigest()


def file_name(scenario: str, seed: int, arm: Arm) -> str:
    """Return the name of an arm's file."""
    return f"{scenario}-{seed}-{arm}.parquet"


def write_arm(path: Path, episode: ArmEpisode) -> None:
    """Write an arm, completely or not at all. Raises OutputError."""
    driving = episode.driving
    columns = {name: pa.array(getattr(driving, name)) for name in NUMBERS}
    FILES.write(path, episode.facts, {"vehicle": named_column(driving.vehicle, driving.names), **columns})


def _check(table: pa.Table) -> None:
    """Raise ValueError, which names the column, unless a table holds what `write_arm` writes."""
    check_types(table, pa.schema([("vehicle", pa.dictionary(pa.int32(), pa.string()))]))
    for name in NUMBERS:
        if name not in table.column_names or not pa.types.is_floating(table.schema.field(name).type):
            raise ValueError(f"{name}: is not a column of numbers")
        values = table[name].to_numpy()
        if np.isnan(values).any() or (name not in MAY_BE_INFINITE and np.isinf(values).any()):
            raise ValueError(f"{name}: is not a number in every row")


FILES = EpisodeFiles(
    ArmFacts,
    b"isac_cosim.closed_loop_arm",
    lambda facts: [file_name(facts.scenario, facts.seed, facts.arm)],
    _check,
)


def read_arm(path: Path) -> ArmEpisode:
    """Read an arm. Raises InputError if the file is damaged, or that of another arm."""
    facts, table = FILES.read(path)
    names, vehicle = names_and_numbers(table["vehicle"])
    numbers = {name: table[name].to_numpy() for name in NUMBERS}
    return ArmEpisode(facts, VehicleMotions(names=names, every_s=facts.every_s, vehicle=vehicle, **numbers))
