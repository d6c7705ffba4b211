"""The shards that a folder holds while its dataset is generated.

Every finished shard adds a line to `shards.jsonl`, its entry. So a command that goes on from there need not read the
shards, and no shard costs more than the one before it. The finished dataset has an index instead, and no such file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dataset import INDEX_FILE, SHARDS, Shard, ShardIndex, files_in, read_shard
from isac_cosim.labeling.dataset.meta import Meta, read_description
from isac_cosim.labeling.dataset.shard_index import TOGETHER
from isac_cosim.labeling.generation.log import append_line

JOURNAL_FILE = "shards.jsonl"


class Journal:
    """The entries of the shards that a folder holds for a study. Call `open` to begin with those that are there."""

    def __init__(self, folder: Path, shards: ShardIndex) -> None:
        self._path = folder / JOURNAL_FILE
        self._parts = [shards]
        self._latest: list[Shard] = []

    @classmethod
    def open(cls, folder: Path, started: Meta) -> Journal:
        """Return the complete shards of a study in a folder.

        started: the unfinished `dataset.json` of the study. A shard whose entry an earlier command noted, and whose
        size is the same, is not read.
        """
        sizes = files_in(folder / SHARDS)
        noted = _noted(folder)
        columns = zip(noted.files, noted.numbers("bytes").tolist(), noted.fingerprints, strict=True)
        whole = [sizes.get(file) == size and mark == started.fingerprint for file, size, mark in columns]
        shards = noted.take(np.flatnonzero(whole))
        journal, listed = cls(folder, shards), set(shards.files)
        for shard in _read([folder / SHARDS / file for file in sorted(sizes) if file not in listed]):
            if shard.episode.fingerprint == started.fingerprint:
                journal.add(shard)
        return journal

    @property
    def shards(self) -> ShardIndex:
        """The entries of all shards, one for each file."""
        self._parts = [ShardIndex.merged([*self._parts, ShardIndex.of(self._latest)])]
        self._latest = []
        return self._parts[0]

    def add(self, shard: Shard) -> None:
        """Note a shard that has been written. Raises OutputError if the file cannot be written."""
        append_line(self._path, shard.model_dump_json())
        self._latest.append(shard)
        if len(self._latest) == TOGETHER:
            # As a table they take a thirtieth of the memory.
            self._parts.append(ShardIndex.of(self._latest))
            self._latest = []

    def remove(self) -> None:
        """Delete the file, once the index has its content."""
        self._path.unlink(missing_ok=True)


def _noted(folder: Path) -> ShardIndex:
    """Return the entries that earlier commands noted in a folder: in an index, in `dataset.json`, or in the journal."""
    described = read_description(folder)
    parts = [] if described is None else [described.shards]
    with suppress(InputError):  # there is none, or it is damaged
        parts.append(ShardIndex.read(folder / INDEX_FILE))
    return ShardIndex.merged([*parts, ShardIndex.of(_lines(folder / JOURNAL_FILE))])


def _lines(path: Path) -> Iterator[Shard]:
    """Yield the entries of a journal; a line that a killed command left incomplete is passed over."""
    with suppress(FileNotFoundError), path.open("rb") as file:
        for line in file:
            with suppress(ValidationError):
                yield Shard.model_validate_json(line)


def _read(paths: Iterable[Path]) -> Iterator[Shard]:
    """Yield the entries of shards by reading their files; those that are damaged are passed over."""

    def read(path: Path) -> Shard | None:
        try:
            return read_shard(path)
        except InputError:
            return None

    remaining = iter(paths)
    # Reading a shard keeps a core busy but releases Python's global lock.
    with ThreadPoolExecutor() as threads:
        while part := list(islice(remaining, TOGETHER)):
            yield from (shard for shard in threads.map(read, part) if shard is not None)
