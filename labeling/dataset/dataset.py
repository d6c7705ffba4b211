"""A dataset on disk: a folder with one Parquet shard per episode, their index, and the lanes of the road networks.

`dataset.json` says how the dataset was made, and `shards.parquet`, the index, what is in each shard. The layout is a
contract, described in docs/dataset.md. `labeling.generation.generate` writes datasets; all other code opens them here.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest, replace_file, shortened
from isac_cosim.base.stored.tables import check_types, open_parquet, read_columns
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.labeling.dataset.content import check_rows
from isac_cosim.labeling.dataset.meta import (
    META_FILE,
    Lost,
    Meta,
    ScenarioMeta,
    SiteMeta,
    read_description,
    read_meta,
    write_meta,
)
from isac_cosim.labeling.dataset.shard import (
    ARRAYS,
    CLASS_NAMES,
    PASSING,
    RUN_IN,
    SCALARS,
    STATE,
    Episode,
    Sample,
    Shard,
    pull_outs_digest,
    read_episode,
    read_shard,
    read_table,
    samples_of,
    schema,
    shard_name,
    write_shard,
)
from isac_cosim.labeling.dataset.shard_index import INDEX_FILE, TOGETHER, ShardIndex
from isac_cosim.labeling.dataset.state_columns import states_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ARRAYS",
    "CLASS_NAMES",
    "INDEX_FILE",
    "META_FILE",
    "SCALARS",
    "STATE",
    "Dataset",
    "Episode",
    "Lost",
    "Meta",
    "RoadLane",
    "Sample",
    "ScenarioMeta",
    "Shard",
    "ShardIndex",
    "SiteMeta",
    "read_description",
    "read_meta",
    "read_shard",
    "shard_name",
    "write_meta",
    "write_roads",
    "write_shard",
]

SHARDS = "shards"
DROPPED_PULL_OUTS = "dropped_pull_outs"
ROADS = "roads"
ROAD_SCHEMA, FORMER_ROAD_SCHEMA = (
    pa.schema([("id", pa.string()), ("width_m", pa.float32()), ("x", pa.list_(of)), ("y", pa.list_(of))])
    for of in (pa.float64(), pa.float32())
)
"""The columns of a file of roads: one row a lane. Before schema version 4, lines were in single precision."""


@dataclass(frozen=True)
class RoadLane:
    """One lane, to draw the road: its centre line `shape`, (n, 2), m, in the scenario's plane, and its width."""

    id: str
    width_m: float
    shape: Array


@dataclass(frozen=True, repr=False)
class Dataset:
    """A dataset that is open for reading. Rows are in the order of `meta.shards`, and within a shard as written.

    Every file is held against its digest when it is first read, and every row against the index. What does not fit
    raises InputError, which names the file and the column.

    folder: that of its shards. Dropped pull-outs, which are in no class, have one of their own: only
    `labeling.dataset.pull_outs.dropped_pull_outs` opens it.
    """

    path: Path
    meta: Meta
    folder: str = SHARDS

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open a folder. Raises InputError if it is not a finished dataset, or if a shard is missing."""
        folder = Path(path)
        meta = read_meta(folder)
        if meta is None:
            raise InputError(f"{folder}: not a dataset (it has no {META_FILE}); make one with `cosim generate`")
        if not meta.complete:
            raise InputError(f"{folder}: dataset is not finished; run the same `{meta.maker}` again to finish it")
        stored = set(files_in(folder / SHARDS))
        for file in meta.shards.files:
            if file not in stored:
                raise InputError(f"{folder / SHARDS / file}: the shard is missing; run the same `{meta.maker}` again")
        return cls(folder, meta)

    def __len__(self) -> int:
        return self.meta.samples

    def __repr__(self) -> str:
        names = [scenario.name for scenario in self.meta.scenarios]
        of = shortened(names[0]) if len(names) == 1 else f"{len(names)} scenarios"
        return f"<Dataset {shortened(self.path)}: {len(self)} samples from {len(self.meta.shards)} episodes of {of}>"

    @cached_property
    def digest(self) -> str:
        """SHA-256 digest of the shards' names and digests. Equal samples give equal digests."""
        shards = self.meta.shards
        lines = "".join(f"{file} {sha256}\n" for file, sha256 in zip(shards.files, shards.digests, strict=True))
        return hashlib.sha256(f"schema {self.meta.schema_version}\n{lines}".encode()).hexdigest()

    def shard_path(self, shard: Shard) -> Path:
        """Return the path of a shard's file."""
        return self.path / self.folder / shard.file

    def frame(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return scalar columns, one row per sample. columns: their names, all of them when absent."""
        names = list(SCALARS if columns is None else columns)
        if unknown := set(names) - set(SCALARS):
            raise ValueError(f"no scalar columns: {sorted(unknown)}")
        tables = [table.select(names) for table in self._tables(names)]
        empty = schema(*self.meta.lengths).empty_table().select(names)
        frame: pd.DataFrame = pa.concat_tables([empty, *tables]).to_pandas()
        return frame

    def arrays(self, *names: str) -> dict[str, Float32Array]:
        """Return state arrays by column name, float32: tv and tv_truth (N, 6, S), uv (N, 6, C), tv_run_in (N, 6, R).

        As they are stored: positions are relative to the points of their records, `frame(["x0", "y0"])`. In the
        scenario's plane they are what `labeling.dataset.record_point.in_plane` makes of them.
        """
        tv_length, uv_length, run_in_length = self.meta.lengths
        lengths = {"tv": tv_length, "tv_truth": tv_length, "uv": uv_length, RUN_IN: run_in_length}
        self._check_numbers()
        arrays = {name: np.empty((len(self), 6, lengths[name]), np.float32) for name in names if name in ARRAYS}
        start = 0
        counts = self.meta.shards.numbers("samples").tolist()
        for samples, part in zip(counts, self.arrays_by_shard(*names), strict=True):
            for name in names:
                arrays[name][start : start + samples] = part[name]
            start += samples
        return arrays

    def arrays_by_shard(self, *names: str) -> Iterator[dict[str, Float32Array]]:
        """Yield the same arrays shard by shard, for datasets that are larger than the memory."""
        if unknown := set(names) - set(schema(*self.meta.lengths).names).intersection(ARRAYS):
            raise ValueError(f"no array columns: {sorted(unknown)}")
        for table in self._tables(list(names)):
            yield {name: states_of(table[name]) for name in names}

    def record(self, name: str, row: int) -> Float32Array:
        """Return one row of an array column as it is stored, (6, length), by reading the shard that holds it."""
        ends = np.cumsum(self.meta.shards.numbers("samples"))
        k = int(np.searchsorted(ends, row, side="right"))
        if not 0 <= row < len(self):
            raise IndexError(f"the dataset has {len(self)} rows")
        states = states_of(self._table(self.meta.shards[k], [name])[name])
        return np.asarray(states[row - int(ends[k])])

    def samples(self, shard: Shard) -> list[Sample]:
        """Return the samples of a shard, in its order."""
        return samples_of(self._table(shard))

    def episode(self, shard: Shard) -> Episode:
        """Return what a shard stores about its episode. Raises InputError if it is damaged or another one's."""
        path = self.checked_path(shard)
        episode = read_episode(path)
        if (episode.scenario, episode.seed) != (shard.episode.scenario, shard.episode.seed):
            raise InputError(
                f"{path}: stores the episode {episode.scenario}, seed {episode.seed}, not that of its name; "
                f"delete it and run the same `{self.meta.maker}` again"
            )
        return episode

    def roads(self, scenario: str) -> list[RoadLane]:
        """Return the lanes of a scenario's road network. The ids of lanes inside junctions begin with a colon.

        Raises InputError if their file is damaged or missing, or if the dataset lists no such scenario.
        """
        if scenario not in (meta.name for meta in self.meta.scenarios):
            raise InputError(f"{self.path}: has samples of {scenario[:60]!r}, which it does not list as a scenario")
        path = self.path / ROADS / f"{scenario}.parquet"
        try:
            if file_digest(path) != self.meta.roads.get(path.name, file_digest(path)):
                raise ValueError(f"its bytes differ from the digest in {META_FILE}")
            return read_roads(path)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path}: is not a file of roads ({reason}); delete it and run the same `{self.meta.maker}` again"
            ) from None

    def sites(self, scenario: str) -> list[Site]:
        """Return the sites of a scenario."""
        meta = next(meta for meta in self.meta.scenarios if meta.name == scenario)
        return [Site(**site.model_dump()) for site in meta.sites]

    def verify(self) -> None:
        """Check every file against its digest, the index and the contract. Raises InputError with the first fault."""
        shards, faults = self.meta.shards, list[str]()
        for scenario in self.meta.scenarios:
            if (self.path / ROADS / f"{scenario.name}.parquet").exists() or self.meta.roads:
                self.roads(scenario.name)
        with ThreadPoolExecutor() as threads:
            for start in range(0, len(shards), TOGETHER):
                for of_shard in threads.map(lambda shard: list(self._faults(shard)), shards[start : start + TOGETHER]):
                    faults += of_shard
        if faults:
            others = f" (and {len(faults) - 1} more faults)" if len(faults) > 1 else ""
            raise InputError(
                f"{faults[0]}{others}; delete the damaged files and run the same `{self.meta.maker}` again"
            )

    def _tables(self, columns: list[str]) -> Iterator[pa.Table]:
        """Yield the named columns of one shard after the other. Raises InputError if a shard is damaged."""
        for shard in self.meta.shards:
            yield self._table(shard, columns)

    def _table(self, shard: Shard, columns: list[str] | None = None) -> pa.Table:
        """Return columns of a shard, all when absent. Raises InputError if it is damaged, or not what was written."""
        path = self.checked_path(shard)
        every = [*SCALARS, *(name for name in ARRAYS if name != RUN_IN or self.meta.run_in_length)]
        try:
            table = read_table(path, columns or every)
            check_rows(table, shard, self.meta, self.folder == DROPPED_PULL_OUTS)
        except (OSError, ValueError) as error:
            raise self._refusal(path, " ".join(str(error).split())) from None
        return table

    def checked_path(self, shard: Shard) -> Path:
        """Return the path of a shard's file. Raises InputError if its bytes are not those that were written."""
        path = self.shard_path(shard)
        try:
            digest = file_digest(path)
        except OSError as error:
            raise self._refusal(path, str(error.strerror)) from None
        if digest != shard.sha256:
            raise self._refusal(path, f"its bytes differ from the digest in {INDEX_FILE}")
        return path

    def _check_numbers(self) -> None:
        """Raise InputError unless each shard has the rows that the index says, before memory is taken for all."""
        for file, samples in zip(self.meta.shards.files, self.meta.shards.numbers("samples").tolist(), strict=True):
            path = self.path / self.folder / file
            try:
                rows = pq.read_metadata(path).num_rows
            except (OSError, ValueError) as error:
                raise self._refusal(path, " ".join(str(error).split())) from None
            if rows != samples:
                raise self._refusal(path, f"it has {rows} rows, and {samples} in the index")

    def _refusal(self, path: Path, reason: str) -> InputError:
        """Return the error for a shard that is damaged."""
        return InputError(
            f"{path}: not a whole shard of a dataset ({reason}); delete it and run the same `{self.meta.maker}` again"
        )

    def _faults(self, shard: Shard) -> Iterator[str]:
        """Yield what is wrong with a shard."""
        path = self.shard_path(shard)
        try:
            table = self._table(shard)
            stored = read_shard(path)
            columns = open_parquet(path).schema_arrow
        except InputError as error:
            yield str(error)
            return
        if stored != shard:
            yield f"{path}: its counts differ from those in {INDEX_FILE}"
        expected = schema(*self.meta.lengths, self.meta.schema_version, set(PASSING) <= set(columns.names))
        if not columns.equals(expected):
            yield f"{path}: its columns differ from the contract of schema version {self.meta.schema_version}"
        ids, prefix = table["sample_id"].to_pylist(), shard.file.removesuffix(".parquet")
        # Records that were sensed anew keep their ids, and a repeated one has a suffix.
        if self.meta.resensed is None and ids != [f"{prefix}-{k}" for k in range(len(ids))]:
            yield f"{path}: sample_id: sample ids are not consecutive"
        digest, dropped = pull_outs_digest(path), self.path / DROPPED_PULL_OUTS / shard.file
        if digest is not None and (not dropped.is_file() or file_digest(dropped) != digest):
            yield f"{path}: delete this one too: its shard of dropped pull-outs, {dropped}, is missing or damaged"


def files_in(folder: Path) -> dict[str, int]:
    """Return the size in bytes of every file in a folder, by name; nothing if there is no folder."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name: entry.stat().st_size for entry in entries if entry.is_file()}
    except (FileNotFoundError, NotADirectoryError):
        return {}


def read_roads(path: Path) -> list[RoadLane]:
    """Return the lanes in a file of roads. Raises OSError or ValueError, which names the column, if it is damaged."""
    table = read_columns(open_parquet(path))
    former = "x" in table.column_names and table.schema.field("x").type == FORMER_ROAD_SCHEMA.field("x").type
    check_types(table, FORMER_ROAD_SCHEMA if former else ROAD_SCHEMA)
    lanes = []
    for row in table.to_pylist():
        if len(row["x"]) != len(row["y"]) or len(row["x"]) < 2:
            raise ValueError(f"x: the line of lane {row['id']!r} has not as many places along x as along y, or below 2")
        lane = RoadLane(row["id"], row["width_m"], np.array([row["x"], row["y"]], np.float64).T)
        if not np.isfinite(lane.shape).all() or not 0 < lane.width_m < np.inf:
            raise ValueError(f"x, y or width_m: of lane {lane.id!r} is not a finite length")
        lanes.append(lane)
    return lanes


def road_digests(folder: Path, scenarios: Iterable[str]) -> dict[str, str]:
    """Return the digest of the file of roads of each scenario, by the file's name."""
    return {f"{name}.parquet": file_digest(folder / ROADS / f"{name}.parquet") for name in scenarios}


def write_roads(folder: Path, scenario: str, lanes: Iterable[Lane | RoadLane]) -> None:
    """Write a scenario's lanes to `roads/<scenario>.parquet`. Raises OutputError."""
    rows = list(lanes)
    columns = {
        "id": [lane.id for lane in rows],
        "width_m": [lane.width_m for lane in rows],
        "x": [lane.shape[:, 0] for lane in rows],
        "y": [lane.shape[:, 1] for lane in rows],
    }
    table = pa.table({field.name: pa.array(columns[field.name], field.type) for field in ROAD_SCHEMA})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    (folder / ROADS).mkdir(exist_ok=True)
    replace_file(folder / ROADS / f"{scenario}.parquet", lambda partial: partial.write_bytes(sink.getvalue()))
