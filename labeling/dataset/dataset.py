"""A dataset on disk: a folder with one Parquet shard per episode, their index, and the lanes of the road networks.

`dataset.json` says how the dataset was made, and `shards.parquet`, the index, what is in each shard. The layout is a
contract, described in docs/dataset.md. `labeling.generation.generate` writes datasets; all other code opens them here.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest, replace_file
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
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
    read_shard,
    read_table,
    schema,
    shard_name,
    states_of,
    write_shard,
)
from isac_cosim.labeling.dataset.shard_index import INDEX_FILE, TOGETHER, ShardIndex
from isac_cosim.labeling.intentions import Intention

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


@dataclass(frozen=True)
class RoadLane:
    """One lane, to draw the road: its centre line `shape`, (n, 2), m, in the scenario's plane, and its width."""

    id: str
    width_m: float
    shape: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Dataset:
    """A dataset that is open for reading. Rows are in the order of `meta.shards`, and within a shard as written.

    folder: that of its shards. Dropped pull-outs, which are in no class, have one of their own: only
    `labeling.dataset.pull_outs.dropped_pull_outs` opens it.
    """

    path: Path
    meta: Meta
    folder: str = SHARDS

    @classmethod
    def open(cls, path: str | Path) -> Dataset:
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
        """Return state arrays by column name, float32: tv and tv_truth (N, 6, S), uv (N, 6, C), tv_run_in (N, 6, R)."""
        tv_length, uv_length, run_in_length = self.meta.lengths
        lengths = {"tv": tv_length, "tv_truth": tv_length, "uv": uv_length, RUN_IN: run_in_length}
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
        """Return one row of an array column, (6, length), by reading the shard that holds it."""
        ends = np.cumsum(self.meta.shards.numbers("samples"))
        k = int(np.searchsorted(ends, row, side="right"))
        if not 0 <= row < len(self):
            raise IndexError(f"the dataset has {len(self)} rows")
        states = states_of(self._table(self.meta.shards[k].file, [name])[name])
        return np.asarray(states[row - int(ends[k])])

    def roads(self, scenario: str) -> list[RoadLane]:
        """Return the lanes of a scenario's road network. The ids of lanes inside junctions begin with a colon.

        Raises InputError if their file is damaged or missing.
        """
        path = self.path / ROADS / f"{scenario}.parquet"
        try:
            rows = pq.ParquetFile(path).read().to_pylist()
            return [RoadLane(row["id"], row["width_m"], np.array([row["x"], row["y"]], np.float32).T) for row in rows]
        except (KeyError, OSError, TypeError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path}: is not a file of roads ({reason}); delete it and run the same `{self.meta.maker}` again"
            ) from None

    def sites(self, scenario: str) -> list[Site]:
        """Return the sites of a scenario."""
        meta = next(meta for meta in self.meta.scenarios if meta.name == scenario)
        return [Site(**site.model_dump()) for site in meta.sites]

    def verify(self) -> None:
        """Check every shard against its digest and the contract. Raises InputError with the first fault."""
        shards, faults = self.meta.shards, []
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
        for file in self.meta.shards.files:
            yield self._table(file, columns)

    def _table(self, file: str, columns: list[str]) -> pa.Table:
        """Return the named columns of a shard's file. Raises InputError if it is damaged."""
        path = self.path / self.folder / file
        try:
            return read_table(path, columns)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path}: not a whole shard of a dataset ({reason}); delete it and run the same "
                f"`{self.meta.maker}` again"
            ) from None

    def _faults(self, shard: Shard) -> Iterator[str]:
        """Yield what is wrong with a shard."""
        path = self.shard_path(shard)
        if file_digest(path) != shard.sha256:
            yield f"{path}: its bytes differ from the digest in {INDEX_FILE}"
            return
        try:
            stored = read_shard(path)
        except InputError as error:
            yield str(error)
            return
        if stored != shard:
            yield f"{path}: its counts differ from those in {INDEX_FILE}"
        table = pq.ParquetFile(path).read()
        passing = set(PASSING) <= set(table.column_names)
        expected = schema(*self.meta.lengths, self.meta.schema_version, passing)
        if not table.schema.equals(expected):
            yield f"{path}: its columns differ from the contract of schema version {self.meta.schema_version}"
            return
        rows = read_table(path)
        yield from (f"{path}: {fault}" for fault in _row_faults(rows, shard, self.meta.resensed is None))
        digest, dropped = pull_outs_digest(path), self.path / DROPPED_PULL_OUTS / shard.file
        if digest is not None and (not dropped.is_file() or file_digest(dropped) != digest):
            yield f"{path}: delete this one too: its shard of dropped pull-outs, {dropped}, is missing or damaged"


def _row_faults(table: pa.Table, shard: Shard, numbered: bool) -> Iterator[str]:
    """Yield what is wrong with the values of a shard whose columns are right.

    numbered: whether the sample ids must be consecutive. Records that were sensed anew keep their ids, and a repeated
    record has a suffix.
    """
    scalars = table.select(list(SCALARS)).to_pandas()
    prefix = shard.file.removesuffix(".parquet")
    ids = scalars["sample_id"]
    if numbered and list(ids) != [f"{prefix}-{k}" for k in range(len(ids))]:
        yield "sample ids are not consecutive"
    if not ids.is_unique or not ids.str.fullmatch(rf"{re.escape(prefix)}-\d+(-r\d+)?").all():
        yield "sample ids do not belong to the shard's episode"
    if list(scalars["intention"]) != [Intention(label).text for label in scalars["label"]]:
        yield "label and intention disagree"
    if ((scalars["cause"] != "") != (scalars["origin"] == "reaction")).any():
        yield "reactions are not the samples with a cause"
    times = scalars[["t_start", "t_onset", "t_commit", "t_end"]].to_numpy()
    if not np.isfinite(times).all() or (np.diff(times[:, 1:]) < 0).any() or (times[:, 0] > times[:, 1]).any():
        yield "times are not in the order start, onset, commit, end"
    for name in set(ARRAYS) & set(table.column_names):
        if not np.isfinite(states_of(table[name])).all():
            yield f"{name} holds values that are not finite"


def files_in(folder: Path) -> dict[str, int]:
    """Return the size in bytes of every file in a folder, by name; nothing if there is no folder."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name: entry.stat().st_size for entry in entries if entry.is_file()}
    except (FileNotFoundError, NotADirectoryError):
        return {}


def write_roads(folder: Path, scenario: str, lanes: Iterable[Lane | RoadLane]) -> None:
    """Write a scenario's lanes to `roads/<scenario>.parquet`. Raises OutputError."""
    rows = list(lanes)
    line = pa.list_(pa.float32())
    table = pa.table(
        {
            "id": pa.array([lane.id for lane in rows], pa.string()),
            "width_m": pa.array([lane.width_m for lane in rows], pa.float32()),
            "x": pa.array([lane.shape[:, 0] for lane in rows], line),
            "y": pa.array([lane.shape[:, 1] for lane in rows], line),
        }
    )
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    (folder / ROADS).mkdir(exist_ok=True)
    replace_file(folder / ROADS / f"{scenario}.parquet", lambda partial: partial.write_bytes(sink.getvalue()))
