"""Archives that claim more than they hold, or whose bytes were changed."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from isac_cosim.base.stored.archives import HARMLESS_BYTES, check_archive


def test_what_was_written_passes(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "zeros.npz", zeros=np.zeros(100_000))
    torch.save({"weight": torch.randn(30, 30)}, tmp_path / "weights.pt")
    for name in ("zeros.npz", "weights.pt"):
        check_archive(tmp_path / name, checksums=True)


def test_a_bomb_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """A gigabyte of zeros, folded twice, in some kilobytes."""
    path = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive,
        archive.open("a.npy", "w") as part,
    ):
        for _ in range(HARMLESS_BYTES // 2**20 + 1):
            part.write(bytes(2**20))
    path.write_bytes(path.read_bytes().replace(b"a.npy", b"b.npy"))
    content = bytearray(path.read_bytes())
    # The directory at the end claims a thousand times as much.
    at = content.rindex(b"PK\x01\x02") + 24
    content[at : at + 4] = (2**32 - 2).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"bomb\.npz: claims to hold 4294967294 bytes"):
        check_archive(path)


def test_a_flipped_bit_is_noticed_which_torch_itself_passes_over(tmp_path: Path) -> None:
    path = tmp_path / "weights.pt"
    torch.save({"weight": torch.ones(1000)}, path)
    content = bytearray(path.read_bytes())
    content[content.index(torch.ones(8).numpy().tobytes())] ^= 1
    path.write_bytes(content)
    assert not torch.load(path, weights_only=True)["weight"].eq(1).all()
    check_archive(path)
    with pytest.raises(ValueError, match="checksum"):
        check_archive(path, checksums=True)


def test_two_parts_of_the_same_name_are_refused(tmp_path: Path) -> None:
    """Two readers may take different ones of them."""
    path = tmp_path / "twice.zip"
    with warnings.catch_warnings(), zipfile.ZipFile(path, "w") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("a", "1")
        archive.writestr("a", "2")
    with pytest.raises(ValueError, match="the same name"):
        check_archive(path)
