"""Arrays in `.npz` files: read without pickle, and only if each is as large as its file says."""

from __future__ import annotations

import tokenize
import zipfile
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.base.stored.archives import check_archive

SUFFIX = ".npy"
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""Readers of the beginning of an array, by the version of its format."""


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an `.npz` file by name.

    Raises OSError, ValueError or zipfile.BadZipFile if the file is no such file, is damaged, holds Python objects, or
    claims arrays of another size than it holds.
    """
    check_archive(path)
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            _check_claim(archive, member, path.name)
    with np.load(path, allow_pickle=False) as stored:
        return dict(stored)


def check_array(
    arrays: dict[str, npt.NDArray[Any]], name: str, kinds: str, shape: Sequence[int | None]
) -> npt.NDArray[Any]:
    """Return one of the arrays of a file, once it is known to be of numbers, finite, and of the right shape.

    kinds: numpy's letters of the kinds of numbers that it may hold, "f" or "iu". shape: None for any length.
    Raises ValueError, which names the array.
    """
    if name not in arrays:
        raise ValueError(f"{name}: is missing")
    array = arrays[name]
    expected = tuple("any" if length is None else length for length in shape)
    if array.ndim != len(shape) or any(
        length not in (None, found) for length, found in zip(shape, array.shape, strict=True)
    ):
        raise ValueError(f"{name}: has the shape {array.shape}, not {expected}")
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name}: holds {array.dtype}, not {'real' if kinds == 'f' else 'whole'} numbers")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{name}: holds numbers that are not finite")
    return array


def _check_claim(archive: zipfile.ZipFile, member: zipfile.ZipInfo, file: str) -> None:
    """Raise ValueError if a member is not an array of numbers or texts, or not of the size that it claims."""
    name = member.filename.removesuffix(SUFFIX)
    if name == member.filename:
        raise ValueError(f"{file}: its part {name} is not an array")
    with archive.open(member) as content:
        version = np.lib.format.read_magic(content)
        if version not in HEADERS:
            raise ValueError(f"{name}: is an array of the unknown format {version}")
        try:
            shape, _, dtype = HEADERS[version](content)
        except (RecursionError, SyntaxError, tokenize.TokenError, TypeError):  # as numpy reads a damaged header
            raise ValueError(f"{name}: does not say what it holds") from None
        if dtype.hasobject:
            raise ValueError(f"{name}: holds Python objects")
        if min(shape, default=0) < 0 or content.tell() + prod(shape) * dtype.itemsize != member.file_size:
            raise ValueError(f"{name}: claims the shape {shape}, which is not what it holds")
