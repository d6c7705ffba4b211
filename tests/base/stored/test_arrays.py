"""Arrays that claim another shape than they have, or that are not numbers."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from isac_cosim.base.stored.arrays import check_array, read_arrays


def claiming(path: Path, shape: tuple[int, ...], dtype: str = "<f8", held: int = 8) -> None:
    """Write a file whose only array claims a shape, and holds so many bytes."""
    buffer = io.BytesIO()
    npy.write_array_header_1_0(buffer, {"descr": dtype, "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", buffer.getvalue() + bytes(held))


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "n": np.array(7), "empty": np.empty((0, 4), np.float32)}
    np.savez_compressed(tmp_path / "arrays.npz", **arrays)
    read = read_arrays(tmp_path / "arrays.npz")
    assert read.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)


@pytest.mark.parametrize("shape", [(10**12,), (2**62, 8), (2,), (0,), (-1,), (1, -(10**9))])
def test_a_claimed_shape_that_is_not_held_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    claiming(tmp_path / "claim.npz", shape)
    with pytest.raises(ValueError, match="a: claims the shape"):
        read_arrays(tmp_path / "claim.npz")


def test_a_header_that_is_no_header_is_refused(tmp_path: Path) -> None:
    """A bracket more, over which numpy's reader stumbles."""
    claiming(tmp_path / "claim.npz", (1,))
    content = (tmp_path / "claim.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "claim.npz") as archive:
        header = archive.read("a.npy")
    assert header in content
    with zipfile.ZipFile(tmp_path / "claim.npz", "w") as archive:
        archive.writestr("a.npy", header.replace(b"(1,)", b"((1,"))
    with pytest.raises(ValueError, match="a: does not say what it holds"):
        read_arrays(tmp_path / "claim.npz")


def test_objects_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "objects.npz", a=np.array([{}], object))
    with pytest.raises(ValueError, match="a: holds Python objects"):
        read_arrays(tmp_path / "objects.npz")


def test_what_is_no_array_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(ValueError, match="is not an array"):
        read_arrays(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("array", "fault"),
    [
        (np.zeros((3, 2)), "a: has the shape"),
        (np.zeros((4, 3), int), "a: holds int64"),
        (np.full((4, 3), np.nan), "a: holds numbers that are not finite"),
        (None, "a: is missing"),
    ],
)
def test_an_array_of_another_kind_is_named(array: np.ndarray | None, fault: str) -> None:
    arrays = {} if array is None else {"a": array}
    with pytest.raises(ValueError, match=fault):
        check_array(arrays, "a", "f", (None, 3))


def test_a_right_array_passes() -> None:
    array = np.zeros((4, 3), np.float32)
    assert check_array({"a": array}, "a", "f", (None, 3)) is array
