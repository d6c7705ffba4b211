"""What the pages of a Parquet file claim to hold, by their headers: Arrow takes that much memory before it unpacks one.

A header is a Thrift structure in the compact protocol. Its second field is the size of the page unpacked, its third
that in the file. Sources: parquet.thrift of apache/parquet-format; doc/specs/thrift-compact-protocol.md of
apache/thrift.
"""

from __future__ import annotations

import mmap
from pathlib import Path

import pyarrow.parquet as pq

UNPACKED, PACKED = 2, 3
"""Numbers of the fields of a page's header."""
STOP, TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(13)
"""Types of the compact protocol."""
DEEPEST = 8
"""No header nests structures deeper."""


def check_pages(path: Path, metadata: pq.FileMetaData) -> None:
    """Raise ValueError unless the pages of each column claim together what the file's metadata says of the column.

    metadata: of the file. Raises OSError if the file cannot be read.
    """
    chunks = [
        metadata.row_group(group).column(column)
        for group in range(metadata.num_row_groups)
        for column in range(metadata.num_columns)
    ]
    # Of a column without values Arrow reads no page, and what is said of the place of its pages is not true.
    chunks = [chunk for chunk in chunks if chunk.num_values]
    if not chunks:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for chunk in chunks:
            begin = min(chunk.data_page_offset, chunk.dictionary_page_offset or chunk.data_page_offset)
            _check_chunk(content, begin, chunk)


def _check_chunk(content: mmap.mmap, begin: int, chunk: pq.ColumnChunkMetaData) -> None:
    """Raise ValueError where the pages of a column, which begin at `begin`, are not those that its metadata claim."""
    name, at, end, unpacked = chunk.path_in_schema, begin, begin + chunk.total_compressed_size, 0
    if not 0 <= begin <= end <= len(content):
        raise ValueError(f"{name}: its pages lie outside the file")
    while at < end:
        try:
            sizes, after = _integers(content, at)
        except IndexError:
            raise ValueError(f"{name}: a page's header is damaged") from None
        if min(sizes.get(UNPACKED, -1), sizes.get(PACKED, -1)) < 0:
            raise ValueError(f"{name}: a page does not say how large it is")
        # Headers count, too.
        unpacked += after - at + sizes[UNPACKED]
        if unpacked > chunk.total_uncompressed_size:
            raise ValueError(
                f"{name}: its pages claim to hold {unpacked} bytes, and the file {chunk.total_uncompressed_size}"
            )
        at = after + sizes[PACKED]


def _integers(content: mmap.mmap, at: int, depth: int = 0) -> tuple[dict[int, int], int]:
    """Return the whole numbers among the fields of a structure, by field, and where it ends.

    Raises IndexError where it is none.
    """
    fields: dict[int, int] = {}
    field = 0
    while (head := content[at]) != STOP:
        kind, step, at = head & 15, head >> 4, at + 1
        if step:
            field += step
        else:
            field, at = _zigzag(content, at)
        if kind in (I16, I32, I64):
            fields[field], at = _zigzag(content, at)
        else:
            at = _after(content, at, kind, depth)
    return fields, at + 1


def _after(content: mmap.mmap, at: int, kind: int, depth: int) -> int:
    """Return where a value ends that is no whole number. Raises IndexError where it is none that headers hold."""
    if kind in (TRUE, FALSE):
        return at
    if kind == BYTE:
        return at + 1
    if kind == DOUBLE:
        return at + 8
    if kind == BINARY:
        length, at = _varint(content, at)
        return at + length
    if kind == STRUCT and depth < DEEPEST:
        return _integers(content, at, depth + 1)[1]
    raise IndexError(f"a value of type {kind}")


def _varint(content: mmap.mmap, at: int) -> tuple[int, int]:
    """Return a number of seven bits a byte, and where it ends. Raises IndexError where it is longer than 64 bits."""
    value = 0
    for shift in range(0, 70, 7):
        byte = content[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise IndexError("a number of more than 64 bits")


def _zigzag(content: mmap.mmap, at: int) -> tuple[int, int]:
    """Return a number with its sign, and where it ends."""
    value, at = _varint(content, at)
    return (value >> 1) ^ -(value & 1), at
