"""What a dataset says of itself: `dataset.json`, and the index of its shards."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, file_digest
from isac_cosim.base.settings import Sealed, Settings, checked, read_json, write_sealed
from isac_cosim.isacsim.scenarios.naming import NAME
from isac_cosim.labeling.dataset.shard import CLASS_NAMES, SCHEMA_VERSION, SHARD_FILE, STATE
from isac_cosim.labeling.dataset.shard_index import INDEX_FILE, ShardIndex

META_FILE = "dataset.json"
MOST_STATES = 1_000_000
"""Largest number of states of a vehicle in a record."""
FASTEST_HZ = 100_000.0
"""Highest sampling rate, Hz."""


class SiteMeta(Settings):
    """A site, with the fields of `isacsim.scenarios.scenario.Site`."""

    id: str
    x: float
    y: float
    height_m: float
    azimuth_deg: float


class ScenarioMeta(Settings):
    """A scenario of a dataset: where it came from, and what is needed to draw its records or sense them anew.

    source: the scenario as the user named it. inputs: the digest of each file and of what else its recordings depend
    on, by name; empty in earlier datasets. sha256: digest of all of them. origin: the origin of its plane in SUMO's
    coordinates, m. drivers: what is to be said of the vehicle types of its demand, whose limits sit at thresholds of
    the labels. remarks: what else its source says of it, such as how far speeds are from those of the positions.
    There are neither in datasets of earlier versions.
    """

    name: str = Field(pattern=NAME)
    source: str
    sha256: str
    inputs: dict[str, str] = Field(default_factory=dict)
    origin: tuple[float, float]
    sites: tuple[SiteMeta, ...]
    drivers: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def identity(self) -> dict[str, Any]:
        """What of it identifies a dataset: `sha256` stands for `inputs`, which earlier datasets lack."""
        return self.model_dump(mode="json", exclude={"inputs", "remarks"})


class Lost(Settings):
    """An episode that failed and was left out."""

    scenario: str = Field(pattern=NAME)
    seed: int
    reason: str


class Meta(Sealed):
    """The content of `dataset.json` and of the index.

    complete: False while episodes are missing. study: all settings, with their defaults. tv_rate_hz, uv_rate_hz,
    duration_s: sampling rates and length of the records. run_in_s: how long before each record the TV's true states are
    stored; 0 before schema version 3. shards: the index. index_sha256: its digest, None while episodes are missing.
    roads: digest of each file of roads, by its name; empty in datasets of earlier versions. lost: episodes that failed.
    short: known intentions with fewer samples than the study requires. resensed: digest of the dataset that the records
    were taken from and the settings that they were sensed anew with (isac_cosim.labeling.generation.resense), None if
    they were generated.
    """

    sealed_since: ClassVar[int] = 4

    schema_version: Literal[2, 3, 4, 5] = SCHEMA_VERSION
    complete: bool
    fingerprint: str
    class_names: tuple[str, ...] = CLASS_NAMES
    state: tuple[str, ...] = STATE
    tv_rate_hz: float = Field(gt=0, le=FASTEST_HZ)
    uv_rate_hz: float = Field(gt=0, le=FASTEST_HZ)
    duration_s: float = Field(gt=0)
    run_in_s: float = Field(0.0, ge=0)
    study: dict[str, Any]
    versions: dict[str, str]
    scenarios: tuple[ScenarioMeta, ...]
    shards: ShardIndex = Field(default_factory=lambda: ShardIndex.of(()), exclude=True)
    index_sha256: str | None = Field(None, pattern=DIGEST)
    roads: dict[Annotated[str, Field(pattern=SHARD_FILE)], Annotated[str, Field(pattern=DIGEST)]] = Field(
        default_factory=dict
    )
    lost: tuple[Lost, ...] = ()
    short: tuple[str, ...] = ()
    resensed: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _of_its_scenarios(self) -> Self:
        known = {scenario.name for scenario in self.scenarios}
        if unknown := set(self.shards.scenarios) - known:
            raise ValueError(f"has shards of scenarios that it does not list: {', '.join(sorted(unknown))}")
        if len(set(self.shards.files)) < len(self.shards):
            raise ValueError("lists a shard twice")
        return self

    @model_validator(mode="after")
    def _of_records_that_fit(self) -> Self:
        # Before any length is rounded, since the product may be more than a whole number can say.
        longest = max(self.duration_s, self.run_in_s) * max(self.tv_rate_hz, self.uv_rate_hz)
        if longest > MOST_STATES or min(self.tv_length, self.uv_length) < 1:
            raise ValueError(
                f"duration_s, run_in_s, tv_rate_hz and uv_rate_hz give records of no or more than {MOST_STATES} states"
            )
        if (self.class_names, self.state) != (CLASS_NAMES, STATE):
            raise ValueError("class_names or state: are not those of this version")
        record = self.study.get("record")
        for name in ("tv_rate_hz", "uv_rate_hz", "duration_s"):
            if isinstance(record, dict) and record.get(name, getattr(self, name)) != getattr(self, name):
                raise ValueError(f"{name}: is not that of the study, study.record.{name}")
        return self

    @property
    def maker(self) -> str:
        """The command that wrote the dataset and can complete or repair it."""
        return "cosim generate" if self.resensed is None else "cosim sense"

    @property
    def tv_length(self) -> int:
        """States of the TV in a record."""
        return round(self.duration_s * self.tv_rate_hz)

    @property
    def uv_length(self) -> int:
        """States of the UV in a record."""
        return round(self.duration_s * self.uv_rate_hz)

    @property
    def run_in_length(self) -> int:
        """States of the TV before a record."""
        return round(self.run_in_s * self.tv_rate_hz)

    @property
    def lengths(self) -> tuple[int, int, int]:
        """Numbers of states: of the TV and of the UV in a record, and of the TV before it."""
        return self.tv_length, self.uv_length, self.run_in_length

    @property
    def samples(self) -> int:
        """Samples of all shards."""
        return int(self.shards.numbers("samples").sum())

    def by_intention(self) -> dict[str, int]:
        """Return the number of samples of every intention, in the order of the labels."""
        return dict(zip(CLASS_NAMES, self.shards.by_intention().sum(axis=0).tolist(), strict=True))

    def by_origin(self) -> dict[str, int]:
        """Return the number of samples of every origin, in alphabetical order."""
        return dict(sorted(self.shards.totals("by_origin").items()))

    def left_out(self) -> dict[str, int]:
        """Return how many candidates did not become samples, by reason."""
        return dict(sorted(self.shards.totals("left_out").items()))


def read_description(folder: Path) -> Meta | None:
    """Return a folder's `dataset.json` without the index, None if there is none.

    Version 0.2.0 had no index and listed the shards in `dataset.json`; those are returned. Raises InputError if the
    file is damaged, or was written by a version that is read no longer.
    """
    return read_json(Meta, folder / META_FILE)


def read_meta(folder: Path) -> Meta | None:
    """Return a folder's `dataset.json` and index, None if there is no `dataset.json`.

    Raises InputError if one of them is damaged, or if they do not belong together.
    """
    meta, path = read_description(folder), folder / INDEX_FILE
    if meta is None or not meta.complete:
        return meta
    if meta.index_sha256 is None:
        # Former versions listed the shards in the file itself.
        if "shards" not in meta.model_fields_set:
            raise InputError(f"{folder / META_FILE}: index_sha256: is missing, so there is no index; {_again(meta)}")
        return meta
    try:
        shards = ShardIndex.read(path)
    except InputError as error:
        raise InputError(f"{error}; {_again(meta)}") from None
    if file_digest(path) != meta.index_sha256:
        raise InputError(f"{path}: its bytes differ from the digest in {META_FILE}; {_again(meta)}")
    return checked(Meta, {**dict(meta), "shards": shards}, path)


def _again(meta: Meta) -> str:
    """Return the advice to repair a dataset."""
    return f"run the same `{meta.maker}` again"


def write_meta(folder: Path, meta: Meta) -> None:
    """Write `dataset.json`, and before it the index if the dataset is complete; each file completely or not at all.

    Raises OutputError.
    """
    if meta.complete:
        meta.shards.write(folder / INDEX_FILE)
    digest = file_digest(folder / INDEX_FILE) if meta.complete else None
    write_sealed(folder / META_FILE, meta.model_copy(update={"index_sha256": digest}))
