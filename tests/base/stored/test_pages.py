"""What pages claim, held against what Arrow wrote, in every form that Arrow writes."""

from __future__ import annotations

import contextlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from isac_cosim.base.stored.pages import check_pages
from isac_cosim.base.stored.tables import open_parquet

OPTIONS = st.fixed_dictionaries(
    {
        "compression": st.sampled_from(["zstd", "snappy", "gzip", "none"]),
        "data_page_version": st.sampled_from(["1.0", "2.0"]),
        "use_dictionary": st.booleans(),
        "write_statistics": st.booleans(),
        "write_page_index": st.booleans(),
        "write_page_checksum": st.booleans(),
        "data_page_size": st.sampled_from([64, 4096, 2**20]),
        "row_group_size": st.sampled_from([7, 1000]),
    }
)


def table(rows: int) -> pa.Table:
    rng = np.random.default_rng(rows)
    inner = pa.FixedSizeListArray.from_arrays(pa.array(rng.normal(size=rows * 12).astype(np.float32)), 4)
    return pa.table(
        {
            "name": pa.array([f"vehicle {k % 5}" for k in range(rows)]),
            "time": rng.normal(size=rows),
            "states": pa.FixedSizeListArray.from_arrays(inner, 3),
            "counts": pa.array([{"a": k, "b": None} for k in range(rows)], pa.map_(pa.string(), pa.int32())),
        }
    )


@settings(deadline=None, max_examples=40)
@example(0, {"compression": "zstd", "use_dictionary": True})
@given(st.integers(0, 300), OPTIONS)
def test_what_arrow_writes_is_accepted(rows: int, options: dict[str, Any]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "t.parquet"
        pq.write_table(table(rows), path, **options)
        check_pages(path, pq.read_metadata(path))


def forged(path: Path, version: str) -> None:
    """Make the first page claim the most that a number of as many bytes can say."""
    pq.write_table(table(200), path, compression="zstd", data_page_version=version, use_dictionary=False)
    content = bytearray(path.read_bytes())
    at = pq.read_metadata(path).row_group(0).column(1).data_page_offset
    # The type of the page, one byte, and then the size; the lowest bit is the sign.
    assert content[at : at + 3] in (b"\x15\x00\x15", b"\x15\x06\x15")
    at += 3
    content[at] = 0xFE
    while content[at] & 128:
        at += 1
        content[at] = content[at] & 128 | 0x7F
    path.write_bytes(content)


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_a_page_that_claims_more_than_its_column_is_refused(tmp_path: Path, version: str) -> None:
    path = tmp_path / "t.parquet"
    forged(path, version)
    with pytest.raises(ValueError, match=r"time: its pages claim to hold \d+ bytes, and the file \d+"):
        open_parquet(path)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 255))
def test_whatever_a_byte_is_it_is_accepted_or_refused(place: int, value: int) -> None:
    """No other error, and an end."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "t.parquet"
        pq.write_table(table(50), path, compression="zstd", data_page_size=64)
        metadata, content = pq.read_metadata(path), bytearray(path.read_bytes())
        content[place % len(content)] = value
        path.write_bytes(content)
        with contextlib.suppress(ValueError):
            check_pages(path, metadata)
