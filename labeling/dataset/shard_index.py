"""The index of a dataset, `shards.parquet`: one row per shard, from which readers choose shards without opening them.

A dataset may have a million shards, so the index stays a table: entries are created when they are accessed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pydantic import GetCoreSchemaHandler, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, core_schema

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, replace_file
from isac_cosim.base.stored.tables import open_parquet, read_columns
from isac_cosim.labeling.dataset.shard import CLASS_NAMES, READABLE, SHARD_FILE, Episode, Shard

INDEX_FILE = "shards.parquet"
TOGETHER = 4096
"""Entries that are converted at a time."""

_COUNTS = pa.map_(pa.string(), pa.int32())
SCHEMA = pa.schema(
    [
        pa.field(name, kind, nullable=False)
        for name, kind in {
            "file": pa.string(),
            "sha256": pa.string(),
            "bytes": pa.int64(),
            "scenario": pa.string(),
            "seed": pa.int64(),
            "samples": pa.int32(),
            "by_intention": pa.struct([pa.field(name, pa.int32(), nullable=False) for name in CLASS_NAMES]),
            "by_origin": _COUNTS,
            "events": _COUNTS,
            "counts": _COUNTS,
            "left_out": _COUNTS,
            "collided": pa.int32(),
            "teleported": pa.int32(),
            "schema_version": pa.int8(),
            "fingerprint": pa.string(),
        }.items()
    ]
)
"""The columns of the file. `counts` and those of the same type map names to positive numbers."""
_MAPS = tuple(field.name for field in SCHEMA if field.type == _COUNTS)
_REPEATED_TEXT = pa.dictionary(pa.int32(), pa.string())
_IN_MEMORY = {
    **dict.fromkeys(("scenario", "fingerprint"), _REPEATED_TEXT),
    **dict.fromkeys(_MAPS, pa.map_(_REPEATED_TEXT, pa.int32())),
}
_ENCODED = pa.schema([field.with_type(_IN_MEMORY.get(field.name, field.type)) for field in SCHEMA])
"""The columns in memory, where texts that recur in many rows are kept once."""
_REPEATED = ("scenario", "fingerprint", *(f"{name}.key_value.key" for name in _MAPS))
"""The paths of those texts in the file."""


class ShardIndex(Sequence[Shard]):
    """The entries of a dataset's shards, in the order of the dataset's rows.

    Prefer whole columns where there may be many shards: creating an entry takes about 0.2 ms. `Meta` accepts a list of
    entries in place of an index, because earlier versions kept one in `dataset.json`.
    """

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    @classmethod
    def of(cls, shards: Iterable[Shard]) -> Self:
        """Return the index of some shards, in their order."""
        remaining, parts = iter(shards), [_ENCODED.empty_table()]
        while part := list(islice(remaining, TOGETHER)):
            parts.append(_table(part))
        return cls(pa.concat_tables(parts))

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read an index. Raises InputError if the file is damaged or is not an index."""
        try:
            if not pq.read_schema(path).equals(SCHEMA):
                raise ValueError("its columns differ from those of an index")
            table = read_columns(open_parquet(path, read_dictionary=_REPEATED)).cast(_ENCODED)
            _check(table)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise InputError(f"{path}: not the index of a dataset ({' '.join(str(error).split())})") from None
        return cls(table)

    def write(self, path: Path) -> None:
        """Write the index completely or not at all; equal entries give equal bytes. Raises OutputError."""
        table = self._plain().combine_chunks()
        replace_file(path, lambda partial: pq.write_table(table, partial, compression="zstd", write_page_checksum=True))

    def __len__(self) -> int:
        return len(self._table)

    @overload
    def __getitem__(self, k: int) -> Shard: ...

    @overload
    def __getitem__(self, k: slice) -> ShardIndex: ...

    def __getitem__(self, k: int | slice) -> Shard | ShardIndex:
        rows = range(len(self))[k]
        return (
            self.take(np.array(rows, np.int64)) if isinstance(rows, range) else _shards(self._table.slice(rows, 1))[0]
        )

    def __iter__(self) -> Iterator[Shard]:
        for start in range(0, len(self), TOGETHER):
            yield from _shards(self._table.slice(start, TOGETHER))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ShardIndex) and bool(self._plain().equals(other._plain()))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"ShardIndex of {len(self)} shards"

    @property
    def files(self) -> list[str]:
        """Names of the shards' files."""
        return self._texts("file")

    @property
    def digests(self) -> list[str]:
        """SHA-256 digests of the shards' files, hexadecimal."""
        return self._texts("sha256")

    @property
    def scenarios(self) -> list[str]:
        """Names of the shards' scenarios."""
        return self._texts("scenario")

    @property
    def fingerprints(self) -> list[str]:
        """Fingerprints of the studies that the shards were generated for."""
        return self._texts("fingerprint")

    def numbers(self, column: str) -> IntArray:
        """Return a column of numbers, (n,): bytes, seed, samples, collided, teleported or schema_version."""
        return np.asarray(self._table[column].to_numpy(), np.int64)

    def by_intention(self) -> IntArray:
        """Return the samples of each shard by intention, (n, 7), in the order of the labels."""
        return _by_intention(self._table)

    def totals(self, column: str) -> Counter[str]:
        """Return the sums over all shards, by name, of by_origin, events, counts or left_out."""
        chunks = self._table[column].chunks
        names = [pc.cast(counts.keys, "string") for counts in chunks]
        numbers = [counts.items for counts in chunks]
        pairs = pa.table(
            [pa.chunked_array(names, pa.string()), pa.chunked_array(numbers, pa.int32())], names=["name", "number"]
        )
        sums = pairs.group_by("name").aggregate([("number", "sum")]).to_pylist()
        return Counter({row["name"]: row["number_sum"] for row in sums})

    def take(self, rows: IntArray) -> ShardIndex:
        """Return the index of some shards, given by their positions, in that order."""
        return ShardIndex(self._table.take(pa.array(rows, pa.int64())))

    def select(self, files: Iterable[str]) -> ShardIndex:
        """Return the index of the shards with these files, in that order. Raises KeyError for an unknown file."""
        position = {file: k for k, file in enumerate(self.files)}
        return self.take(np.array([position[file] for file in files], np.int64))

    @classmethod
    def merged(cls, parts: Sequence[ShardIndex]) -> Self:
        """Return the entries of all parts, of several for the same file the last one."""
        both = cls(pa.concat_tables([_ENCODED.empty_table(), *(part._table for part in parts)]))
        last = {file: k for k, file in enumerate(both.files)}
        return cls(both._table.take(pa.array(last.values(), pa.int64())))

    def _texts(self, column: str) -> list[str]:
        """Return a column of texts."""
        # A hundred times as fast as `to_pylist`.
        texts: list[str] = self._table[column].cast(pa.string()).to_numpy().tolist()
        return texts

    def _plain(self) -> pa.Table:
        """Return the table with the types of the file."""
        return self._table.cast(SCHEMA)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let `Meta` hold an index, and make one of the list of shards in a former `dataset.json`."""

        def index_of(value: Any, listed: ValidatorFunctionWrapHandler) -> ShardIndex:
            return value if isinstance(value, ShardIndex) else cls.of(listed(value))

        return core_schema.no_info_wrap_validator_function(index_of, handler.generate_schema(tuple[Shard, ...]))


def _table(shards: Sequence[Shard]) -> pa.Table:
    """Return entries as a table with the types that an index has in memory."""
    episodes = [shard.episode for shard in shards]
    columns: dict[str, list[Any]] = {
        **{name: [getattr(shard, name) for shard in shards] for name in ("file", "sha256", "bytes", "samples")},
        "by_intention": [{name: shard.by_intention.get(name, 0) for name in CLASS_NAMES} for shard in shards],
        "by_origin": [list(shard.by_origin.items()) for shard in shards],
    }
    for name in SCHEMA.names:
        if name not in columns:
            values = [getattr(episode, name) for episode in episodes]
            columns[name] = [list(counts.items()) for counts in values] if name in _MAPS else values
    table = pa.table([pa.array(columns[field.name], field.type) for field in SCHEMA], schema=SCHEMA)
    return table.cast(_ENCODED)


def _shards(table: pa.Table) -> list[Shard]:
    """Return the entries of some rows."""
    return [
        Shard(
            **{name: row[name] for name in ("file", "sha256", "bytes", "samples", "by_origin")},
            by_intention={name: number for name, number in row["by_intention"].items() if number},
            episode=Episode(**{name: value for name, value in row.items() if name in Episode.model_fields}),
        )
        for row in table.to_pylist(maps_as_pydicts="strict")
    ]


def _by_intention(table: pa.Table) -> IntArray:
    """Return the samples of each shard by intention, (n, 7)."""
    counts = table["by_intention"]
    return np.stack([np.asarray(pc.struct_field(counts, name), np.int64) for name in CLASS_NAMES], axis=1)


def _check(table: pa.Table) -> None:
    """Raise ValueError if the rows cannot be entries of shards, in particular if a name leads out of the folder."""
    file, scenario = table["file"], pc.cast(table["scenario"], "string")
    named = pc.binary_join_element_wise(scenario, pc.cast(table["seed"], "string"), "-")
    by_intention, samples = _by_intention(table), table["samples"].to_numpy()
    checks = {
        "a file's name": pc.match_substring_regex(file, SHARD_FILE),
        "a file that is not of its episode": pc.equal(file, pc.binary_join_element_wise(named, "parquet", ".")),
        "a digest": pc.match_substring_regex(table["sha256"], DIGEST),
        "a schema version": pc.is_in(table["schema_version"], pa.array(READABLE, pa.int8())),
        "a file's size": pc.greater_equal(table["bytes"], 0),
        "a number of samples": pc.greater_equal(table["samples"], 0),
        "a number by intention": pa.array((by_intention.min(axis=1) >= 0) & (by_intention.sum(axis=1) == samples)),
        "a number of collided or teleported vehicles": pc.greater_equal(
            pc.min_element_wise(table["collided"], table["teleported"]), 0
        ),
    }
    for fault, sound in checks.items():
        if not pc.all(sound, min_count=0).as_py():
            raise ValueError(f"{fault} is wrong")
    if pc.count_distinct(file).as_py() != len(file):
        raise ValueError("a shard is listed twice")
