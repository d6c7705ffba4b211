"""The types of arrays that signatures name, and what signals share; shapes and units are in the docstrings."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

Signal = TypeVar("Signal", Array, ComplexArray)


def reflected(values: Signal, before: int, after: int) -> Signal:
    """Return a signal, (n,), continued beyond its ends by point reflection, (before + n + after,).

    It is what `numpy.pad` gives with the mode `reflect` of the type `odd`, in a fraction of the time.
    """
    count = len(values)
    if count <= max(before, after):
        return np.pad(values, (before, after), mode="reflect", reflect_type="odd")
    result = np.empty(before + count + after, values.dtype)
    result[:before] = 2 * values[0] - values[before:0:-1]
    result[before : before + count] = values
    result[before + count :] = 2 * values[-1] - values[-2 : -after - 2 : -1]
    return result
