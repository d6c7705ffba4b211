"""A table of trajectories in the format of NGSIM, with its units and conventions as they are in the file.

Format: Next Generation Simulation (NGSIM) Vehicle Trajectories, data.transportation.gov, 8ect-6jqj, of 2018, and the
data dictionaries of its I-80 and US-101 sets. A row has 18 columns; `.txt` files have blanks between them and no
header, `.csv` files have commas and one, and the file with all places has further columns and is not sorted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array
from isac_cosim.isacsim.traffic.trajectory_files.tables import (
    Codes,
    Columns,
    batches,
    check_columns,
    content_head,
    header_of,
    reading,
)

COLUMNS = (
    "Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y", "v_Length",
    "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Headway", "Time_Headway",
)  # fmt: skip
"""Of a file without a header, in order."""
NEEDED = (
    "Vehicle_ID", "Frame_ID", "Global_Time", "Local_X", "Local_Y", "v_Length", "v_Width", "v_Class", "Lane_ID",
)  # fmt: skip
WHOLE = frozenset({"Vehicle_ID", "Frame_ID", "Global_Time", "v_Class", "Lane_ID"})
"""Columns of whole numbers; the others are in feet, or feet a second."""
SPEED, PLACE, FRAMES = "v_Vel", "Location", "Total_Frames"
NUMBER = re.compile(rb"-?\d+(\.\d*)?")
FOOT_M = 0.3048
MOST = 1e14
"""Numbers beyond this are no times in ms, and no feet."""
CHUNK = 1 << 18


@dataclass
class NgsimRows:
    """The states of one place, shape (n,) each, in the order of the file, in SI units.

    vehicle: the file's number of the vehicle. frame: of the camera. time_ms: since 1970, ms. across: of the front
    centre from the left edge of the section, m. along: m. length, width: m. kind: 1 motorcycle, 2 car, 3 truck. lane: 1
    is the leftmost one. speed: m/s; None if the file names none. number: the line of the file.
    """

    vehicle: IntArray
    frame: IntArray
    time_ms: IntArray
    across: Array
    along: Array
    length: Array
    width: Array
    kind: IntArray
    lane: IntArray
    speed: Float32Array | None
    number: Int32Array

    def __len__(self) -> int:
        return len(self.vehicle)

    def take(self, which: IntArray) -> None:
        """Keep some of the rows, in another order, column by column: a long file fills the memory once, not twice."""
        for column in fields(self):
            if (values := getattr(self, column.name)) is not None:
                setattr(self, column.name, values[which])


def read_ngsim(file: Path, place: str | None) -> NgsimRows:
    """Return the states at one place of a file.

    place: the value of `Location`; None where the file has a single one. Raises InputError where the file cannot be
    read, lacks a column, holds a value that cannot be, or has not that place alone.
    """
    header = _has_header(file)
    of, places = _values(file, header)
    here = _at_place(places, place, len(of["Vehicle_ID"]), file)
    del places
    number = (here + (2 if header else 1)).astype(np.int32)
    if not len(number):
        raise InputError(f"{file}: holds no state of a vehicle; fetch it again")
    # Each column is given up as the one is made that takes its place.
    for name in [*of]:
        values = of.pop(name)[here]
        wrong = ~(np.abs(values) < MOST)
        if name == SPEED:
            wrong &= ~np.isnan(values)
        elif name in WHOLE and not wrong.any():
            wrong = values != np.rint(values)
        if wrong.any():
            row = int(np.argmax(wrong))
            found = "missing" if np.isnan(values[row]) else f"{values[row]:g}"
            fault = ", which is no whole number" if abs(values[row]) < MOST else ""
            raise InputError(f"{file}: row {number[row]}: {name} is {found}{fault}; fix it")
        of[name] = values.astype(np.int64) if name in WHOLE else values * FOOT_M
    speed = of[SPEED].astype(np.float32) if SPEED in of else None
    return NgsimRows(
        of["Vehicle_ID"], of["Frame_ID"], of["Global_Time"], of["Local_X"], of["Local_Y"], of["v_Length"],
        of["v_Width"], of["v_Class"], of["Lane_ID"], speed, number,
    )  # fmt: skip


def is_ngsim(file: Path) -> bool:
    """Return whether a file begins as one of NGSIM: with its columns, or with as many numbers. Raises InputError."""
    if _has_header(file):
        return {name.lower() for name in NEEDED} <= {name.lower() for name in header_of(file)}
    first = content_head(file, 1 << 12).split(b"\n", 1)[0].replace(b",", b" ").split()
    return len(first) == len(COLUMNS) and all(NUMBER.fullmatch(part) for part in first)


def _has_header(file: Path) -> bool:
    first = content_head(file, 1 << 12).split(b"\n", 1)[0]
    return any(byte in b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_" for byte in first)


def _values(file: Path, header: bool) -> tuple[dict[str, Any], _Places | None]:
    """Return the columns of numbers, and the places, if the file has any."""
    read, names = Columns(), Codes()
    for numbers, named in _tables(file) if header else _blanks(file):
        for name, column in numbers.items():
            read.add(name, column)
        if named is not None:
            read.add(PLACE, names.of(named.fill_null("(none)")))
    places = _Places(names.names, read.take(PLACE)) if PLACE in read else None
    return {name: read.take(name) for name in (*NEEDED, SPEED) if name in read or name != SPEED}, places


@dataclass(frozen=True)
class _Places:
    """The places of a file, and the number of that of each row, (n,)."""

    names: tuple[str, ...]
    number: Int32Array


_Part = tuple[Mapping[str, Array], pa.Array | None]


def _tables(file: Path) -> Iterator[_Part]:
    """Yield the rows of a file with a header, whose names may be written in other cases."""
    header = header_of(file)
    names = {name.lower(): name for name in header}
    check_columns(file, [name.lower() for name in header], [name.lower() for name in NEEDED])
    wanted = {names[name.lower()]: name for name in (*NEEDED, SPEED) if name.lower() in names}
    columns: dict[str, pa.DataType] = dict.fromkeys(wanted, pa.float64())
    if (place := names.get(PLACE.lower())) is not None:
        columns[place] = pa.string()
    for batch in batches(file, columns, ()):
        numbers = {name: np.array(batch[own].to_numpy(zero_copy_only=False), float) for own, name in wanted.items()}
        yield numbers, None if place is None else batch[place]


def _blanks(file: Path) -> Iterator[_Part]:
    """Yield the rows of a file without a header, with blanks or commas between its columns."""
    import pandas as pd  # loaded only here, because every command imports this module

    separator = "," if b"," in content_head(file, 1 << 12).split(b"\n", 1)[0] else r"\s+"
    wanted, further = (*NEEDED, SPEED), "further"
    line, last = 1, _LastVehicle()
    with reading(file):
        # All columns are read, and one more: else rows with others than these would be shifted unnoticed.
        chunks = pd.read_csv(
            file, sep=separator, header=None, names=[*COLUMNS, further], dtype=np.float64, chunksize=CHUNK,
            index_col=False, on_bad_lines="error", compression=None,
        )  # fmt: skip
        for chunk in cast("Iterator[pd.DataFrame]", chunks):
            odd = chunk[further].notna().to_numpy() | (chunk[COLUMNS[-1]].isna().to_numpy() & (separator != ","))
            if odd.any():
                raise InputError(
                    f"{file}: row {line + int(np.argmax(odd))}: has not {len(COLUMNS)} columns; leave it out, or fix it"
                )
            line += len(chunk)
            last.add(chunk["Vehicle_ID"].to_numpy(), chunk[FRAMES].to_numpy())
            yield {name: chunk[name].to_numpy(np.float64) for name in wanted}, None
    last.check(file)


@dataclass
class _LastVehicle:
    """The vehicle of the last row of a file: number, rows at the end, and how many the file says it has.

    ordered: whether vehicles follow each other, as in the files of one place; others may well end with any row.
    """

    number: float = -np.inf
    rows: int = 0
    said: float = 0.0
    ordered: bool = True

    def add(self, vehicle: Array, frames: Array) -> None:
        """Go on with the next rows."""
        if not len(vehicle):
            return
        self.ordered &= bool(vehicle[0] >= self.number and (np.diff(vehicle) >= 0).all())
        others = np.flatnonzero(vehicle != vehicle[-1])
        own = len(vehicle) - (int(others[-1]) + 1 if len(others) else 0)
        self.rows = own + (self.rows if own == len(vehicle) and vehicle[-1] == self.number else 0)
        self.number, self.said = float(vehicle[-1]), float(frames[-1])

    def check(self, file: Path) -> None:
        """Raise InputError where the last vehicle has fewer rows than it should have."""
        if self.ordered and self.rows < self.said:
            raise InputError(
                f"{file}: vehicle {self.number:g}, its last one, has {self.rows} rows, and {FRAMES} says "
                f"{self.said:g}: it is cut off; fetch it again, or leave that vehicle out"
            )


def _at_place(places: _Places | None, wanted: str | None, count: int, file: Path) -> IntArray:
    """Return which of so many rows are at a place. Raises InputError where it is not clear which place is meant."""
    if places is None:
        if wanted is not None:
            raise InputError(f"{file}: has no column {PLACE}; leave out the setting location, {wanted}")
        return np.arange(count)
    found = sorted(places.names)
    if wanted is None and len(found) > 1:
        raise InputError(
            f"{file}: holds the places {', '.join(found)[:200]}; name one of them in [dataset.ngsim] location"
        )
    if wanted is not None and wanted not in found:
        raise InputError(f"{file}: holds no place {wanted}, but {', '.join(found)[:200]}; name one of them as location")
    return np.flatnonzero(places.number == places.names.index(wanted or found[0]))
