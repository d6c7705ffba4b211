"""Tables that claim more than they hold, lack values, or are of other types."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from isac_cosim.base.stored import tables
from isac_cosim.base.stored.tables import check_types, least_bytes, open_parquet, read_columns

STATES = pa.list_(pa.list_(pa.float32(), 4), 6)
COLUMNS = pa.schema([("name", pa.string()), ("states", STATES)])


def rows(count: int, length: int = 4) -> pa.Table:
    flat = pa.array(np.zeros(count * 6 * length, np.float32))
    inner = pa.FixedSizeListArray.from_arrays(flat, length)
    states = pa.FixedSizeListArray.from_arrays(inner, 6)
    return pa.table({"name": pa.array(["a"] * count), "states": states})


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    pq.write_table(rows(5), tmp_path / "t.parquet")
    table = read_columns(open_parquet(tmp_path / "t.parquet"))
    check_types(table, COLUMNS)
    assert table.equals(rows(5))
    assert len(read_columns(open_parquet(tmp_path / "t.parquet"), ["name"])) == 5


def test_a_bomb_is_refused_before_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros that take a thousandth of what they unfold to."""
    path = tmp_path / "bomb.parquet"
    pq.write_table(rows(200, 20_000), path, compression="zstd", row_group_size=200)
    assert path.stat().st_size * tables.MOST_RATIO < 200 * 6 * 20_000 * 4
    monkeypatch.setattr(tables, "HARMLESS_BYTES", 2**20)
    monkeypatch.setattr(pq.ParquetFile, "read", None)
    with pytest.raises(ValueError, match="claims to hold 9600"):
        open_parquet(path)


def test_types_that_differ_are_named() -> None:
    with pytest.raises(ValueError, match=r"states: the column is of .*\[5\]"):
        check_types(rows(2, 5), COLUMNS)
    with pytest.raises(ValueError, match="states: the column is missing"):
        check_types(rows(2).select(["name"]), COLUMNS)


def test_missing_values_are_named(tmp_path: Path) -> None:
    pq.write_table(pa.table({"name": pa.array(["a", None])}), tmp_path / "t.parquet")
    with pytest.raises(ValueError, match="name: lacks values"):
        read_columns(open_parquet(tmp_path / "t.parquet"))


def test_texts_that_are_no_text_are_refused(tmp_path: Path) -> None:
    raw = pa.Array.from_buffers(
        pa.string(), 1, [None, pa.py_buffer(np.array([0, 2], np.int32)), pa.py_buffer(b"\xff\xfe")]
    )
    pq.write_table(pa.table({"name": raw}), tmp_path / "t.parquet")
    with pytest.raises(ValueError, match="UTF8"):
        read_columns(open_parquet(tmp_path / "t.parquet"))


def test_the_least_size_of_a_value() -> None:
    assert least_bytes(STATES) == 6 * 4 * 4
    assert least_bytes(pa.string()) == 0
    assert least_bytes(pa.struct([("a", pa.int32()), ("b", pa.float64())])) == 12
