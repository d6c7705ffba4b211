"""Files of episodes: Parquet tables of what vehicles did, which say in their metadata what episode they hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.tables import open_parquet, read_columns

Facts = TypeVar("Facts", bound=Settings)


@dataclass(frozen=True)
class EpisodeFiles(Generic[Facts]):
    """How the episodes of one kind are stored.

    facts: class of what a file says of its episode, under `key`. names: names that the file of an episode may have.
    check: raises ValueError, which names the column, if the table of an episode does not hold what it should.
    """

    facts: type[Facts]
    key: bytes
    names: Callable[[Facts], Sequence[str]]
    check: Callable[[pa.Table], None]

    def write(self, path: Path, facts: Facts, columns: Mapping[str, pa.Array], **options: Any) -> None:
        """Write an episode, completely or not at all. options: of `pyarrow.parquet.write_table`. Raises OutputError."""
        table = pa.table(columns).replace_schema_metadata({self.key: facts.model_dump_json()})
        options |= {"compression": "zstd", "write_page_checksum": True}
        replace_file(path, lambda partial: pq.write_table(table, partial, **options))

    def read_facts(self, path: Path) -> Facts | None:
        """Return what a file says of its episode, or None if it is not the file of a complete one."""
        try:
            return self.facts.model_validate_json(pq.read_metadata(path).metadata[self.key])
        except (KeyError, TypeError, OSError, ValueError):
            return None

    def read(self, path: Path, wanted: Callable[[str], bool] = lambda column: True) -> tuple[Facts, pa.Table]:
        """Return an episode's facts and those of its columns that are wanted.

        Raises InputError if the file is damaged, or that of another episode.
        """
        facts = self.read_facts(path)
        try:
            if facts is None:
                raise ValueError("it has no facts of an episode")
            if path.name not in (names := self.names(facts)):
                raise ValueError(f"it is {names[0]}, renamed")
            file = open_parquet(path)
            table = read_columns(file, [column for column in file.schema_arrow.names if wanted(column)])
            self.check(table)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{path}: not a complete episode ({reason}); delete it and run the same command again"
            ) from None
        return facts, table


def named_column(numbers: IntArray, names: Sequence[str]) -> pa.Array:
    """Return the column of vehicles with these numbers, (n,), in their names."""
    return pa.DictionaryArray.from_arrays(pa.array(numbers, pa.int32()), pa.array(names, pa.string()))


def names_and_numbers(column: pa.ChunkedArray) -> tuple[tuple[str, ...], IntArray]:
    """Return the names of vehicles, and their numbers in a column that `named_column` made, (n,)."""
    whole = column.combine_chunks()
    whole = whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole
    return tuple(whole.dictionary.to_pylist()), whole.indices.to_numpy().astype(np.int64)
