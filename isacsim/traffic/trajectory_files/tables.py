"""Tables of others, in CSV or Parquet, gzipped or not: read a batch at a time, and no more than their size deserves."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from isac_cosim.base.errors import InputError
from isac_cosim.base.stored.tables import open_parquet
from isac_cosim.base.temporary import TemporaryFolder, writing_temporary
from isac_cosim.isacsim.scenarios.xml_files import GZIP, MOST_RATIO, RATIO_FREE, limit_bytes, one_line
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array

BLOCK = 1 << 22
"""Bytes of a CSV file that are parsed at once."""
BATCH = 1 << 18
"""Rows of a Parquet file that are decoded at once."""
CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
"""Bytes that are in no text."""
PARQUET = b"PAR1"
"""How a Parquet file begins."""


class TooLargeError(Exception):
    """A file holds more than is read; the message says how much."""


class Decompressed:
    """The content of a gzipped file, to be read once. Raises TooLargeError where it is too much for the file's size."""

    def __init__(self, file: Path) -> None:
        self._file = gzip.open(file)  # noqa: SIM115 - closed with this object
        self._most = min(limit_bytes(), max(MOST_RATIO * file.stat().st_size, RATIO_FREE))
        self._read = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, size: int) -> bytes:
        """Return the next bytes; none at the end."""
        block = self._file.read(size)
        self._read += len(block)
        if self._read > self._most:
            raise TooLargeError(f"holds more than {self._most / 1e6:.0f} MB: decompress it, if you trust it")
        return block


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Turn the errors of reading a table into an InputError that names it."""
    try:
        yield
    except InputError:
        raise
    except TooLargeError as error:
        raise InputError(f"{file}: {error}") from None
    except (pa.ArrowException, OSError, EOFError, ValueError, KeyError, zlib.error, UnicodeError) as error:
        raise InputError(
            f"{file}: cannot be read as a table ({one_line(error)[:300]}); it may be cut off: fetch or write it again"
        ) from None


def is_gzipped(file: Path) -> bool:
    """Return whether a file is gzipped, by its first bytes. Raises InputError where it cannot be read."""
    return head(file).startswith(GZIP)


def head(file: Path, size: int = 4) -> bytes:
    """Return the first bytes of a file. Raises InputError where it cannot be read."""
    try:
        with file.open("rb") as opened:
            return opened.read(size)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); give a file that can") from None


def content_head(file: Path, size: int = 1 << 16) -> bytes:
    """Return the first bytes of a file's content, decompressed. Raises InputError where it cannot be read."""
    if not is_gzipped(file):
        return head(file, size)
    with reading(file), Decompressed(file) as opened:
        return opened.read(size)


def batches(file: Path, columns: Mapping[str, pa.DataType], needed: Sequence[str], delimiter: str = ",",
            names: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:  # fmt: skip
    """Yield the rows of a CSV or Parquet file, a batch at a time, with those of the columns that it has.

    columns: wanted, with their types. needed: those of them that a file must have. delimiter: between the columns of a
    CSV file. names: of all columns of a CSV file without a header. Raises InputError where the file cannot be read or
    lacks a column.
    """
    with reading(file), _plain(file) as plain:
        if head(plain, 4) == PARQUET:
            yield from _parquet(file, plain, columns, needed)
        else:
            yield from _csv(file, plain, columns, needed, delimiter, names)


@contextmanager
def _plain(file: Path) -> Iterator[Path]:
    """Yield a file, or a temporary one with its content where it is gzipped.

    Arrow reads ahead in threads of its own, which must not wait for Python to decompress.
    """
    if not is_gzipped(file):
        yield file
        return
    with TemporaryFolder() as temporary:
        plain = temporary.path / "table"
        with Decompressed(file) as stream, plain.open("wb") as out:
            while block := stream.read(BLOCK):
                with writing_temporary():
                    out.write(block)
        yield plain


def _csv(
    file: Path,
    plain: Path,
    columns: Mapping[str, pa.DataType],
    needed: Sequence[str],
    delimiter: str,
    names: Sequence[str] | None,
) -> Iterator[pa.RecordBatch]:
    if names is None:
        header = header_of(plain, delimiter)
        check_columns(file, header, needed)
    else:
        header = list(names)
    reader = pa_csv.open_csv(
        plain,
        read_options=pa_csv.ReadOptions(
            block_size=BLOCK, column_names=header, skip_rows=int(names is None), use_threads=False
        ),
        parse_options=pa_csv.ParseOptions(delimiter=delimiter),
        convert_options=pa_csv.ConvertOptions(
            column_types={name: kind for name, kind in columns.items() if name in header},
            include_columns=[name for name in columns if name in header],
            strings_can_be_null=True,
            null_values=["", "null", "NULL"],
        ),
    )
    rows = int(names is None)
    for batch in reader:
        rows += len(batch)
        yield batch
    if _is_quoted(plain) and rows < (lines := _lines(plain)):
        raise InputError(
            f"{file}: {lines} lines are {rows} rows, because a quotation mark is not closed on its line; leave it out"
        )


def _is_quoted(file: Path) -> bool:
    """Return whether a file has quotation marks."""
    with file.open("rb") as opened:
        return any(b'"' in block for block in iter(lambda: opened.read(BLOCK), b""))


def _lines(file: Path) -> int:
    """Return the number of lines that are not empty."""
    with file.open("rb") as opened:
        return sum(1 for line in opened if line.strip())


def header_of(file: Path, delimiter: str = ",") -> list[str]:
    """Return the names of a CSV file's columns. Raises InputError where the file cannot be read."""
    line = content_head(file).split(b"\n", 1)[0]
    if CONTROL.search(line):
        raise InputError(f"{file}: is neither text nor Parquet; give a CSV or a Parquet file")
    first = line.decode("utf-8-sig", "replace").strip()
    return [name.strip().strip('"') for name in first.split(delimiter)]


def _parquet(
    file: Path, plain: Path, columns: Mapping[str, pa.DataType], needed: Sequence[str]
) -> Iterator[pa.RecordBatch]:
    with open_parquet(plain) as table:
        present = table.schema_arrow.names
        check_columns(file, present, needed)
        wanted = {name: kind for name, kind in columns.items() if name in present}
        schema = pa.schema(list(wanted.items()))
        for batch in table.iter_batches(BATCH, columns=list(wanted), use_threads=False):
            ordered = batch.select(list(wanted))
            ordered.validate(full=True)
            yield ordered.cast(schema)


def check_columns(file: Path, present: Sequence[str], needed: Sequence[str]) -> None:
    """Raise InputError where a table lacks a column or has one twice."""
    for name in needed:
        if present.count(name) != 1:
            fault = "has no column" if name not in present else "has more than one column"
            raise InputError(f"{file}: {fault} {name} (it has {', '.join(present)[:200]}); write it with that column")


class Columns:
    """Columns of numbers that are put together part by part, and take hardly more memory than they hold.

    Parts that are kept until the end would be there twice when they are joined: the allocator keeps what lies between
    others.
    """

    def __init__(self) -> None:
        self._held: dict[str, np.ndarray[Any, Any]] = {}
        self._rows: dict[str, int] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._held

    def add(self, name: str, part: np.ndarray[Any, Any]) -> None:
        """Add the next part of a column. The first one tells its type."""
        rows = self._rows.get(name, 0)
        held = self._held.setdefault(name, np.empty(0, part.dtype))
        if rows + len(part) > len(held):
            held.resize(max(rows + len(part), len(held) + len(held) // 8), refcheck=False)
        held[rows : rows + len(part)] = part
        self._rows[name] = rows + len(part)

    def take(self, name: str, kind: Any = np.float64) -> np.ndarray[Any, Any]:
        """Return a column, which is given up here. kind: its type where it has no part."""
        held = self._held.pop(name, np.empty(0, kind))
        held.resize(self._rows.pop(name, 0), refcheck=False)
        return held


class Codes:
    """Numbers for texts, in the order in which they are met."""

    def __init__(self) -> None:
        self.numbers: dict[str, int] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The texts, by number."""
        return tuple(self.numbers)

    def number(self, text: str) -> int:
        """Return the number of a text."""
        return self.numbers.setdefault(text, len(self.numbers))

    def of(self, column: pa.Array) -> Int32Array:
        """Return the number of each text of a column; -1 for what is missing."""
        encoded = column.dictionary_encode() if not pa.types.is_dictionary(column.type) else column
        known = np.array([self.number(text) for text in encoded.dictionary.to_pylist()] or [0], np.int32)
        indices = np.asarray(encoded.indices.fill_null(-1), np.int64)
        return np.asarray(np.where(indices < 0, -1, known[indices]), np.int32)
