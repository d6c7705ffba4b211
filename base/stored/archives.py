"""Zip archives, the form of `.pt`, `.skops` and `.npz` files: what they claim is checked before they are read."""

from __future__ import annotations

import zipfile
from pathlib import Path

MOST_RATIO = 1000
"""Largest ratio of what an archive claims to hold to its own size."""
HARMLESS_BYTES = 64 * 2**20
"""What an archive may hold whatever its size."""


def check_archive(path: Path, checksums: bool = False) -> None:
    """Raise ValueError if an archive claims far more than it can hold, or if the checksum of a part is wrong.

    checksums: whether to check them here, for readers that pass over them, such as PyTorch; numpy and skops do not.
    Raises OSError or zipfile.BadZipFile if the file is no archive.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        names = [member.filename for member in members]
        if len(set(names)) < len(names):
            raise ValueError(f"{path.name}: two of its parts have the same name")
        claimed = sum(member.file_size for member in members)
        if claimed > max(HARMLESS_BYTES, MOST_RATIO * path.stat().st_size):
            raise ValueError(f"{path.name}: claims to hold {claimed} bytes in {path.stat().st_size}")
        if checksums and (damaged := archive.testzip()) is not None:
            raise ValueError(f"{path.name}: the checksum of its part {damaged} is wrong")
