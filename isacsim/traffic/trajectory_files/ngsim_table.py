"""A table of trajectories in the format of NGSIM, with its units and conventions as they are in the file.

Format: Next Generation Simulation (NGSIM) Vehicle Trajectories, data.transportation.gov, 8ect-6jqj, of 2018, and the
data dictionaries of its I-80 and US-101 sets. A row has 18 columns; `.txt` files have blanks between them and no
header, `.csv` files have commas and one, and the file with all places has further columns and is not sorted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pyarrow as pa

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.tables import batches, check_columns, content_head, header_of, reading

COLUMNS = (
    "Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y", "v_Length",
    "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Headway", "Time_Headway",
)  # fmt: skip
"""Of a file without a header, in order."""
NEEDED = (
    "Vehicle_ID", "Frame_ID", "Global_Time", "Local_X", "Local_Y", "v_Length", "v_Width", "v_Class", "Lane_ID",
)  # fmt: skip
SPEED, PLACE = "v_Vel", "Location"
FOOT_M = 0.3048
MOST = 1e14
"""Numbers beyond this are no times in ms, and no feet."""
CHUNK = 1 << 18


@dataclass(frozen=True)
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
    speed: Array | None
    number: IntArray

    def __len__(self) -> int:
        return len(self.vehicle)

    def of(self, which: IntArray | BoolArray) -> NgsimRows:
        """Return some of the rows."""
        speed = None if self.speed is None else self.speed[which]
        return NgsimRows(
            self.vehicle[which], self.frame[which], self.time_ms[which], self.across[which], self.along[which],
            self.length[which], self.width[which], self.kind[which], self.lane[which], speed, self.number[which],
        )  # fmt: skip


def read_ngsim(file: Path, place: str | None) -> NgsimRows:
    """Return the states at one place of a file.

    place: the value of `Location`; None where the file has a single one. Raises InputError where the file cannot be
    read, lacks a column, holds a value that cannot be, or has not that place alone.
    """
    header = _has_header(file)
    values, places = _values(file, header)
    here = _at_place(places, place, len(values["Vehicle_ID"]), file)
    number = np.flatnonzero(here) + (2 if header else 1)
    if not len(number):
        raise InputError(f"{file}: holds no state of a vehicle; fetch it again")
    kept = {name: column[here] for name, column in values.items()}
    for name in NEEDED:
        if (wrong := np.flatnonzero(~(np.abs(kept[name]) < MOST))).size:
            found = "missing" if np.isnan(kept[name][wrong[0]]) else f"{kept[name][wrong[0]]:g}"
            raise InputError(f"{file}: row {number[wrong[0]]}: {name} is {found}; fix it")
    whole = {
        name: kept[name].astype(np.int64) for name in ("Vehicle_ID", "Frame_ID", "Global_Time", "v_Class", "Lane_ID")
    }
    for name, column in whole.items():
        if (wrong := np.flatnonzero(column != kept[name])).size:
            raise InputError(
                f"{file}: row {number[wrong[0]]}: {name} is {kept[name][wrong[0]]:g}, which is no whole number; fix it"
            )
    speed = kept[SPEED] * FOOT_M if SPEED in kept else None
    return NgsimRows(
        whole["Vehicle_ID"], whole["Frame_ID"], whole["Global_Time"], kept["Local_X"] * FOOT_M,
        kept["Local_Y"] * FOOT_M, kept["v_Length"] * FOOT_M, kept["v_Width"] * FOOT_M, whole["v_Class"],
        whole["Lane_ID"], speed, number,
    )  # fmt: skip


def _has_header(file: Path) -> bool:
    first = content_head(file, 1 << 12).split(b"\n", 1)[0]
    return any(byte in b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_" for byte in first)


def _values(file: Path, header: bool) -> tuple[dict[str, Array], list[str | None] | None]:
    """Return the columns of numbers, and that of the places, if the file has one."""
    parts: dict[str, list[Array]] = {name: [] for name in NEEDED}
    places: list[str | None] | None = None
    for numbers, named in _tables(file) if header else _blanks(file):
        for name, column in numbers.items():
            parts.setdefault(name, []).append(column)
        if named is not None:
            places = (places or []) + named
    return {name: np.concatenate(held) if held else np.empty(0) for name, held in parts.items()}, places


_Part = tuple[Mapping[str, Array], list[str | None] | None]


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
        yield numbers, None if place is None else batch[place].to_pylist()


def _blanks(file: Path) -> Iterator[_Part]:
    """Yield the rows of a file without a header, with blanks or commas between its columns."""
    separator = "," if b"," in content_head(file, 1 << 12).split(b"\n", 1)[0] else r"\s+"
    wanted = (*NEEDED, SPEED)
    with reading(file):
        chunks = pd.read_csv(
            file, sep=separator, header=None, names=list(COLUMNS), usecols=list(wanted), dtype=np.float64,
            chunksize=CHUNK, index_col=False, on_bad_lines="error", compression=None,
        )  # fmt: skip
        for chunk in cast("Iterator[pd.DataFrame]", chunks):
            yield {name: chunk[name].to_numpy(np.float64) for name in wanted}, None


def _at_place(places: Sequence[str | None] | None, wanted: str | None, count: int, file: Path) -> BoolArray:
    """Return which of so many rows are at a place. Raises InputError where it is not clear which place is meant."""
    if places is None:
        if wanted is not None:
            raise InputError(f"{file}: has no column {PLACE}; leave out the setting location, {wanted}")
        return np.ones(count, bool)
    found = sorted({place or "(none)" for place in places})
    if wanted is None and len(found) > 1:
        raise InputError(
            f"{file}: holds the places {', '.join(found)[:200]}; name one of them in [dataset.ngsim] location"
        )
    if wanted is not None and wanted not in found:
        raise InputError(f"{file}: holds no place {wanted}, but {', '.join(found)[:200]}; name one of them as location")
    return np.array([(place or "(none)") == (wanted or found[0]) for place in places], bool)
