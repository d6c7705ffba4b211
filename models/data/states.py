"""The state arrays of many records on disk, read as they are needed, for datasets that are larger than the memory.

Parquet cannot be read at random places. So the columns that are needed are first copied, shard by shard, to a file of
plain float32 values, which is mapped into memory: the system loads the pages that are touched and drops them when
memory is scarce. Every process of a training maps the same file and reads its own share of the windows.

The file lies in the folder for temporary files (`TMPDIR`), which needs room for all records: 60 kB each by default.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.temporary import TemporaryFolder, writing_temporary

COMPONENTS = 6


class StatesOnDisk:
    """States of N records in a file, (N, 6, S), float32. Equal to an array in what `windows` returns.

    path: of the file. count: records in it. length: S. rows: those of the N records, in order, (N,). owner: keeps the
    file's folder; the file is deleted with the last object that has it.
    """

    def __init__(self, path: Path, count: int, length: int, rows: IntArray, owner: TemporaryFolder | None):
        self.path, self.count, self.length, self.rows, self._owner = path, count, length, rows, owner

    @classmethod
    def copied(
        cls, parts: Iterable[Mapping[str, Float32Array]], count: int, lengths: Mapping[str, int]
    ) -> dict[str, Self]:
        """Copy arrays of `count` records, which come in parts, to files. Returns the states by column.

        lengths: of the states of each column. Raises OutputError where the folder for temporary files has no room.
        """
        owner = TemporaryFolder()
        paths = {name: owner.path / f"{name}.f32" for name in lengths}
        for part in parts:
            for name, path in paths.items():
                with writing_temporary(), path.open("ab") as file:
                    file.write(np.ascontiguousarray(part[name], np.float32).data)
        rows = np.arange(count)
        return {name: cls(path, count, lengths[name], rows, owner) for name, path in paths.items()}

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def shape(self) -> tuple[int, int, int]:
        """N, 6 and S, as of an array."""
        return len(self.rows), COMPONENTS, self.length

    def __getitem__(self, row: int) -> Float32Array:
        """Return the states of one record, (6, S)."""
        return np.array(self._values[self.rows[row]])

    def take(self, rows: npt.NDArray[np.bool_] | IntArray) -> StatesOnDisk:
        """Return the states of some records, given as a mask (N,) or as positions; nothing is read."""
        return StatesOnDisk(self.path, self.count, self.length, self.rows[rows], self._owner)

    def windows(self, row: IntArray, last: IntArray, length: int) -> Array:
        """Return the `length` samples that end at `last` of some records, (n, 6, length), float64."""
        return cut_out(self._values, self.rows[row], last, length)

    @cached_property
    def _values(self) -> Float32Array:
        if not self.count:
            return np.empty((0, COMPONENTS, self.length), np.float32)
        return np.memmap(self.path, np.float32, "r", shape=(self.count, COMPONENTS, self.length))

    def __getstate__(self) -> dict[str, Any]:
        """Other processes map the file anew. This one keeps it for them."""
        return {name: value for name, value in self.__dict__.items() if name != "_values"} | {"_owner": None}


States = Float32Array | StatesOnDisk
"""States of N records, (N, 6, S)."""


def take(states: States, rows: npt.NDArray[np.bool_] | IntArray) -> States:
    """Return the states of some records, given as a mask (N,) or as positions."""
    return states.take(rows) if isinstance(states, StatesOnDisk) else states[rows]


def windows_of(states: States, row: IntArray, last: IntArray, length: int) -> Array:
    """Return the `length` samples that end at `last` of some records, (n, 6, length), float64."""
    if isinstance(states, StatesOnDisk):
        return states.windows(row, last, length)
    return cut_out(states, row, last, length)


def cut_out(values: Float32Array, row: IntArray, last: IntArray, length: int) -> Array:
    """Return the `length` samples that end at `last` of some rows of an array, (n, 6, length), float64."""
    cut = np.empty((len(row), values.shape[1], length))
    for place, record, end in zip(cut, row.tolist(), (last + 1).tolist(), strict=True):
        place[:] = values[record, :, end - length : end]
    return cut
