"""One shard: the samples of one episode (a scenario and a seed) in a Parquet file.

The columns, their types and their encodings are a contract, described in docs/dataset.md. Equal samples give equal
bytes, so that the SHA-256 digests of two shards show whether they hold the same data.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Literal, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import Field, ValidationError, field_validator, model_validator

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, file_digest, replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.tables import open_parquet, read_columns
from isac_cosim.base.validation import first_fault
from isac_cosim.isacsim.scenarios.naming import NAME
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts
from isac_cosim.labeling.dataset.state_columns import states_column, states_of
from isac_cosim.labeling.intentions import Intention

SCHEMA_VERSION: Literal[5] = 5
"""Of the samples that are written. 2 (2026-11): UVs report with noise by default, and the link budget's cross-section
follows 3GPP TR 38.901. 3 (2026-11): `origin` tells reactions from commands, and the columns `cause`, `cause_ttc_s`,
`tv_run_in`, `pull_out`, `t_pass` and `t_pair_end` are new. The last three are missing from the first datasets of
schema 3. 4 (2026-12): positions are relative to the point of their record, `x0` and `y0`; `tv_departed` is new.
5 (2026-12): the columns `TRACK` say which of the network's tracks stands for the TV."""
READABLE = (2, 3, 4, 5)
"""Schema versions that can be read."""
FORMER_ORIGINS = {"stimulated": "commanded"}
"""Origins of schema 2, and what they are called now."""
STATE = ("x", "y", "vx", "vy", "ax", "ay")
"""The rows of every state array: of the front bumper's centre, in the scenario's plane, in m, m/s and m/s2. Positions
are relative to the point of the record (`labeling.dataset.record_point`)."""
RUN_IN = "tv_run_in"
"""The array column that a dataset lacks if nothing is sensed before its records, and before schema version 3."""
ARRAYS = ("tv", "tv_truth", "uv", RUN_IN)
CLASS_NAMES = tuple(intention.text for intention in Intention)
PASSING = ("pull_out", "t_pass", "t_pair_end")
"""The columns that say whether and when the TV passes the UV."""
TRACK = ("track_id", "right_share", "breaks", "position_sd_m")
"""The columns that say which track stands for the TV, where the sites sense all vehicles at once."""
ROW_GROUP = 256
SHARD_FILE = rf"{NAME.removesuffix('$')}\.parquet$"
"""Names of shards' files."""
_EPISODE_KEY = b"cosim.episode"
_PULL_OUTS_KEY = b"cosim.pull_outs"


@dataclass(frozen=True)
class Sample:
    """One row of a dataset: the record of a TV-UV pair, its label and its provenance.

    t_start, t_onset, t_commit, t_end: start of the record; onset, commit and end of the event; s of simulation time.
    snr_db: mean per-element SNR over the record, dB. n_sites: number of sites used, the least over the record.
    cause: name of what the driver reacted to, empty unless the origin is `reaction`. cause_ttc_s: time to collision
    when the driver began to move, s; NaN if there is none.
    pull_out: what became of a pull-out behind the UV (`labeling.samples.pull_outs`), empty for all other samples.
    t_pass, t_pair_end: of a pull-out, when the TV passes the UV and until when the pair is observed, s; otherwise NaN.
    x0, y0: point of the scenario's plane to which the positions in the four arrays are relative, m.
    tv_departed: when the demand lets the TV depart, s of simulation time; NaN where the motion source does not say. A
    vehicle with the same id and departure in two seeds is the same one in the demand.
    track_id, right_share, breaks, position_sd_m: which of the network's tracks stands for the TV, and how well
    (`isacsim.sensing.passages.TrackUse`); empty, NaN, 0 and NaN of sensors that know whom they watch.
    tv, tv_truth: sensed and true states of the TV, float32, (6, S), at the TV rate. uv: reported states of the UV,
    float32, (6, C), at the UV rate. tv_run_in: true states of the TV just before the record, while the filter settles,
    float32, (6, R), at the TV rate; R may be 0. The rows are those of `STATE`.
    """

    sample_id: str
    scenario: str
    seed: int
    source: str
    tv_id: str
    uv_id: str
    intention: Intention
    origin: str
    t_start: float
    t_onset: float
    t_commit: float
    t_end: float
    sensor: str
    snr_db: float
    n_sites: int
    tv: Float32Array
    tv_truth: Float32Array
    uv: Float32Array
    cause: str = ""
    cause_ttc_s: float = nan
    tv_run_in: Float32Array = field(default_factory=lambda: np.empty((len(STATE), 0), np.float32))
    pull_out: str = ""
    t_pass: float = nan
    t_pair_end: float = nan
    x0: float = 0.0
    y0: float = 0.0
    tv_departed: float = nan
    track_id: str = ""
    right_share: float = nan
    breaks: int = 0
    position_sd_m: float = nan


class Episode(Settings):
    """What a shard stores about its episode besides the samples.

    fingerprint: digest of the study, inputs and versions, which reveals a shard from elsewhere. events: number of
    events by intention. counts: number of things that are not events (see `labeling.detectors.events.Labels`).
    left_out: number of candidates that did not become samples, by reason. collided, teleported: number of vehicles.
    fix_error_m, state_error_m: median distance to the true position in each sample, m, of the fused fixes before the
    filter and of the sensed states. traffic: what became of the demand; None where the motion is not SUMO's, and in
    earlier datasets. scene: how well the network knew who was where, None of sensors that know whom they watch. Only
    the shard's file holds these four (`read_episode`), the index does not.
    """

    scenario: str = Field(pattern=NAME)
    seed: int
    schema_version: Literal[2, 3, 4, 5] = SCHEMA_VERSION
    fingerprint: str = ""
    events: dict[str, int] = Field(default_factory=dict)
    counts: dict[str, int] = Field(default_factory=dict)
    left_out: dict[str, int] = Field(default_factory=dict)
    collided: int = 0
    teleported: int = 0
    fix_error_m: tuple[float, ...] = ()
    state_error_m: tuple[float, ...] = ()
    traffic: TrafficFacts | None = None
    scene: SceneScores | None = None


class Shard(Settings):
    """A shard's entry in the index: its file, digest and size, and what is in it."""

    file: str = Field(pattern=SHARD_FILE)
    sha256: str = Field(pattern=DIGEST)
    bytes: int
    samples: int
    by_intention: dict[str, int]
    by_origin: dict[str, int]
    episode: Episode

    @field_validator("by_origin")
    @classmethod
    def _present_origins(cls, by_origin: dict[str, int]) -> dict[str, int]:
        """Give the origins of former schemas their present names."""
        return {FORMER_ORIGINS.get(name, name): number for name, number in by_origin.items()}

    @field_validator("episode")
    @classmethod
    def _brief(cls, episode: Episode) -> Episode:
        """Drop what only the shard's file holds, so that long lists of shards fit into memory."""
        return episode.model_copy(update={"fix_error_m": (), "state_error_m": (), "traffic": None, "scene": None})

    @model_validator(mode="after")
    def _named_by_its_episode(self) -> Self:
        if self.file != shard_name(self.episode.scenario, self.episode.seed):
            raise ValueError(f"{self.file} is not the file of {self.episode.scenario!r}, seed {self.episode.seed}")
        return self


def shard_name(scenario: str, seed: int) -> str:
    """Return the file name of an episode's shard."""
    return f"{scenario}-{seed}.parquet"


def schema(
    tv_length: int, uv_length: int, run_in_length: int = 0, version: int = SCHEMA_VERSION, passing: bool = True
) -> pa.Schema:
    """Return the columns of a shard.

    tv_length, uv_length: numbers of states of the TV and of the UV in a record. run_in_length: of the TV before it;
    with 0, there is no column of them. version: of the schema. passing: whether it has the columns `PASSING`, which
    former schemas and the first datasets of version 3 lack.
    """

    def states(length: int) -> pa.DataType:
        return pa.list_(pa.list_(pa.float32(), length), len(STATE))

    types = {
        "sample_id": pa.string(),
        "scenario": pa.string(),
        "seed": pa.int64(),
        "source": pa.string(),
        "tv_id": pa.string(),
        "uv_id": pa.string(),
        "intention": pa.string(),
        "label": pa.int8(),
        "origin": pa.string(),
        "cause": pa.string(),
        "cause_ttc_s": pa.float32(),
        "t_start": pa.float64(),
        "t_onset": pa.float64(),
        "t_commit": pa.float64(),
        "t_end": pa.float64(),
        "pull_out": pa.string(),
        "t_pass": pa.float64(),
        "t_pair_end": pa.float64(),
        "sensor": pa.string(),
        "snr_db": pa.float32(),
        "n_sites": pa.int8(),
        "x0": pa.float64(),
        "y0": pa.float64(),
        "tv_departed": pa.float64(),
        "track_id": pa.string(),
        "right_share": pa.float32(),
        "breaks": pa.int16(),
        "position_sd_m": pa.float32(),
        "tv": states(tv_length),
        "tv_truth": states(tv_length),
        "uv": states(uv_length),
    }
    if version < 3:
        del types["cause"], types["cause_ttc_s"]
    if version < 3 or not passing:
        for name in PASSING:
            del types[name]
    if version < 5:
        for name in TRACK:
            del types[name]
    if version < 4:
        del types["x0"], types["y0"], types["tv_departed"]
    if run_in_length:
        types[RUN_IN] = states(run_in_length)
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in types.items()])


SCALARS = tuple(name for name in schema(1, 1).names if name not in ARRAYS)
ORIGIN = schema(1, 1).field("origin")
LACKING = {
    "cause": "", "cause_ttc_s": nan, "pull_out": "", "t_pass": nan, "t_pair_end": nan, "x0": 0.0, "y0": 0.0,
    "tv_departed": nan, "track_id": "", "right_share": nan, "breaks": 0, "position_sd_m": nan,
}  # fmt: skip
"""The columns that older datasets lack, and what they are read as."""


def write_shard(
    folder: Path,
    samples: Sequence[Sample],
    episode: Episode,
    tv_length: int,
    uv_length: int,
    run_in_length: int = 0,
    dropped_pull_outs: Shard | None = None,
) -> Shard:
    """Write an episode's samples as one shard into a folder, completely or not at all, and return its entry.

    samples: may be empty. tv_length, uv_length, run_in_length: as in `schema`. dropped_pull_outs: the entry of the
    episode's shard of dropped pull-outs, which is written before, if there is one; its digest is stored.
    Raises OutputError if the file cannot be written.
    """
    columns = schema(tv_length, uv_length, run_in_length)
    table = pa.Table.from_arrays([_column(field, samples) for field in columns], schema=columns)
    metadata: dict[bytes, str] = {_EPISODE_KEY: episode.model_dump_json()}
    if dropped_pull_outs is not None:
        metadata[_PULL_OUTS_KEY] = dropped_pull_outs.sha256
    table = table.replace_schema_metadata(metadata)
    floats = [name for name in columns.names if pa.types.is_floating(columns.field(name).type)]
    path = folder / shard_name(episode.scenario, episode.seed)
    replace_file(
        path,
        lambda partial: pq.write_table(
            table,
            partial,
            compression="zstd",
            write_page_checksum=True,
            row_group_size=ROW_GROUP,
            use_dictionary=[name for name in columns.names if pa.types.is_string(columns.field(name).type)],
            use_byte_stream_split=[
                *floats,
                *(f"{name}.list.element.list.element" for name in ARRAYS if name in columns.names),
            ],
        ),
    )
    return _describe(path, table, episode)


def read_table(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Return columns of a shard, all of them when absent, as the present schema has them.

    Origins of former schemas are renamed, and columns that they lack are added, as `LACKING` says. Raises OSError or
    ValueError for a damaged file.
    """
    file = open_parquet(path)
    present = file.schema_arrow.names
    if missing := [name for name in columns or () if name not in present and name not in LACKING]:
        raise ValueError(f"{missing[0]}: the column is missing")
    stored = [name for name in columns or present if name in present]
    # Without a column to read there would be no rows.
    table = read_columns(file, [*stored, *([] if stored else ["sample_id"])])
    lacking = [name for name in LACKING if name not in present]
    if not lacking:
        return table
    if "cause" in lacking and "origin" in stored:
        origins = [FORMER_ORIGINS.get(name, name) for name in table["origin"].to_pylist()]
        table = table.set_column(table.schema.get_field_index("origin"), ORIGIN, pa.array(origins, pa.string()))
    for name in lacking:
        column = schema(1, 1).field(name)
        table = table.append_column(column, pa.array([LACKING[name]] * len(table), column.type))
    wanted = list(columns) if columns is not None else [*SCALARS, *ARRAYS]
    return table.select([name for name in wanted if name in table.column_names])


def samples_of(table: pa.Table) -> list[Sample]:
    """Return the samples in all columns of a shard. Raises KeyError if a column or an intention is unknown."""
    states = {name: states_of(table[name]) for name in ARRAYS if name != RUN_IN or name in table.column_names}
    rows = table.select([name for name in SCALARS if name != "label"]).to_pylist()
    return [
        Sample(
            **{**row, "intention": Intention[row["intention"].upper()]},
            **{name: values[k] for name, values in states.items()},
        )
        for k, row in enumerate(rows)
    ]


def read_episode(path: Path) -> Episode:
    """Return a shard's episode, by reading only the end of its file. Raises InputError if that is damaged."""
    try:
        return Episode.model_validate_json(pq.read_metadata(path).metadata[_EPISODE_KEY])
    except (KeyError, TypeError, OSError, ValueError) as error:
        raise InputError(f"{path}: not a whole shard of a dataset ({_reason(error)})") from None


def pull_outs_digest(path: Path) -> str | None:
    """Return the SHA-256 digest of the shard of dropped pull-outs that belongs to a shard; None if there is none.

    Reads only the end of the shard's file. Raises InputError if that is damaged.
    """
    try:
        digest = (pq.read_metadata(path).metadata or {}).get(_PULL_OUTS_KEY)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a whole shard of a dataset ({_reason(error)})") from None
    return None if digest is None else digest.decode()


def read_shard(path: Path) -> Shard:
    """Return a shard's entry by reading the whole file. Raises InputError if the file is damaged or not a shard."""
    try:
        table = read_columns(open_parquet(path))
        stored = json.loads(table.schema.metadata[_EPISODE_KEY])
        if (version := stored.get("schema_version")) not in READABLE:
            raise InputError(
                f"{path}: a shard of schema version {version}, not {SCHEMA_VERSION}; read it with the tool's version "
                "that wrote it, or delete it and generate again"
            )
        episode = Episode.model_validate(stored)
        if path.name != shard_name(episode.scenario, episode.seed):
            raise ValueError(f"stores the episode {episode.scenario}, seed {episode.seed}, not that of its name")
        return _describe(path, table, episode)
    except (AttributeError, KeyError, TypeError, OSError, ValueError) as error:
        raise InputError(
            f"{path}: not a whole shard of a dataset ({_reason(error)}); delete it and generate again"
        ) from None


def _reason(error: Exception) -> str:
    """Return why a file is not a shard, in one line."""
    return first_fault(error, Episode) if isinstance(error, ValidationError) else " ".join(str(error).split())


def _describe(path: Path, table: pa.Table, episode: Episode) -> Shard:
    """Return the entry of a shard that has been written or read."""
    return Shard(
        file=path.name,
        sha256=file_digest(path),
        bytes=path.stat().st_size,
        samples=len(table),
        by_intention=_count(table["intention"].to_pylist(), CLASS_NAMES),
        by_origin=_count(table["origin"].to_pylist()),
        episode=episode,
    )


def _count(values: Sequence[str], order: Sequence[str] = ()) -> dict[str, int]:
    """Return how often each value occurs: first the values in `order`, then the others alphabetically."""
    counted = Counter(values)
    ranked = [value for value in order if value in counted]
    return {value: counted[value] for value in [*ranked, *sorted(set(counted) - set(ranked))]}


def _column(field: pa.Field, samples: Sequence[Sample]) -> pa.Array:
    if field.name in ARRAYS:
        return states_column(field, [getattr(sample, field.name) for sample in samples])
    if field.name == "label":
        return pa.array([int(sample.intention) for sample in samples], field.type)
    if field.name == "intention":
        return pa.array([sample.intention.text for sample in samples], field.type)
    return pa.array([getattr(sample, field.name) for sample in samples], field.type)
