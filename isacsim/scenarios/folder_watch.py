"""Compares the folders of a scenario's files before and after a simulation, where the kernel cannot guard them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from isac_cosim.base.errors import InputError

SMALL_BYTES = 65_536
"""Files up to this size are compared by their content too."""


@contextmanager
def unchanged(scenario: str, files: Iterable[Path]) -> Iterator[None]:
    """Raise InputError at the end where a file is new or changed in the folders that some files lie in.

    scenario: its name, for the message.
    """
    folders = {file.resolve().parent for file in files}
    before = _states(folders)
    try:
        yield
    finally:
        after = _states(folders)
        if written := sorted(path for path, state in after.items() if before.get(path) != state):
            others = f" and {len(written) - 1} more" if len(written) > 1 else ""
            raise InputError(
                f"{written[0]}{others} changed while SUMO simulated {scenario}: remove what makes SUMO write from its "
                "files, or leave the folder alone meanwhile"
            )


def _states(folders: Iterable[Path]) -> dict[str, tuple[int, int, str]]:
    """Size, time of the last change, and digest if they are small, of the files in some folders, by path."""
    states = {}
    for folder in folders:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_file(follow_symlinks=False):
                    state = entry.stat(follow_symlinks=False)
                    small = state.st_size <= SMALL_BYTES and os.access(entry.path, os.R_OK)
                    digest = hashlib.sha256(Path(entry.path).read_bytes()).hexdigest() if small else ""
                    states[entry.path] = (state.st_size, state.st_mtime_ns, digest)
    return states
