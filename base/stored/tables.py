"""Parquet files: opened only if what they claim to hold fits their size, and checked as a whole when they are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.stored.pages import check_pages

MOST_RATIO = 1000
"""Largest ratio of what a file claims to hold to its own size."""
HARMLESS_BYTES = 64 * 2**20
"""What a file may hold whatever its size."""


def open_parquet(path: Path, **options: Any) -> pq.ParquetFile:
    """Open a Parquet file, whose pages' checksums are checked as they are read.

    options: those of `pyarrow.parquet.ParquetFile`.
    Raises OSError or ValueError if it is no Parquet file, or claims far more than it can hold.
    """
    file = pq.ParquetFile(path, page_checksum_verification=True, **options)
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    if min((group.num_rows for group in groups), default=0) < 0 or file.metadata.num_rows != sum(
        group.num_rows for group in groups
    ):
        raise ValueError(f"claims {file.metadata.num_rows} rows, which is not what its parts add up to")
    claimed = sum(group.column(k).total_uncompressed_size for group in groups for k in range(group.num_columns))
    most = max(HARMLESS_BYTES, MOST_RATIO * path.stat().st_size)
    decoded = file.metadata.num_rows * sum(least_bytes(field.type) for field in file.schema_arrow)
    if max(claimed, decoded) > most:
        raise ValueError(f"claims to hold {max(claimed, decoded)} bytes in {path.stat().st_size}")
    check_pages(path, file.metadata)
    names = file.schema_arrow.names
    if len(set(names)) < len(names):
        raise ValueError("two of its columns have the same name")
    return file


def read_columns(file: pq.ParquetFile, columns: Sequence[str] | None = None) -> pa.Table:
    """Return columns of an open file, all of them when absent. Raises OSError or ValueError if it is damaged."""
    table = file.read(columns)
    if len(table) != file.metadata.num_rows:
        raise ValueError(f"holds {len(table)} rows, not the {file.metadata.num_rows} that it claims")
    # Texts that are no text, and places of list entries that lie outside the list.
    table.validate(full=True)
    for name in table.column_names:
        if table[name].null_count:
            raise ValueError(f"{name}: lacks values")
    return table


def check_types(table: pa.Table, columns: pa.Schema) -> None:
    """Raise ValueError unless a table has every one of the columns, of that type."""
    for field in columns:
        if field.name not in table.column_names:
            raise ValueError(f"{field.name}: the column is missing")
        found = table.schema.field(field.name).type
        if found != field.type:
            raise ValueError(f"{field.name}: the column is of {found}, not of {field.type}")


def least_bytes(kind: pa.DataType) -> int:
    """Return how many bytes a value of a type takes at least; 0 for those of varying length."""
    if pa.types.is_fixed_size_list(kind):
        return int(kind.list_size) * least_bytes(kind.value_type)
    if pa.types.is_struct(kind):
        return sum(least_bytes(kind.field(k).type) for k in range(kind.num_fields))
    try:
        return int(kind.bit_width) // 8
    except ValueError:  # of varying length
        return 0
