"""Columns of states, nested fixed-size lists, to arrays and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from isac_cosim.base.arrays import Float32Array


def states_of(column: pa.ChunkedArray) -> Float32Array:
    """Return a column of states, nested fixed-size lists, as an array, (n, 6, length), float32."""
    length = column.type.value_type.list_size
    chunks = [chunk.flatten().flatten().to_numpy(zero_copy_only=False) for chunk in column.chunks]
    flat = np.concatenate(chunks) if chunks else np.empty(0, np.float32)
    return flat.reshape(-1, 6, length)


def states_column(field: pa.Field, states: Sequence[Float32Array]) -> pa.Array:
    """Return states, (6, length) each, as a column. Raises ValueError where they are not what the field holds."""
    length = field.type.value_type.list_size
    for state in states:
        if state.shape != (6, length) or state.dtype != np.float32:
            raise ValueError(f"{field.name}: {state.dtype} {state.shape} where float32 {(6, length)} is stored")
    flat = np.stack(states).ravel() if states else np.empty(0, np.float32)
    rows = pa.FixedSizeListArray.from_arrays(pa.array(flat), type=field.type.value_type)
    return pa.FixedSizeListArray.from_arrays(rows, type=field.type)
