"""The folder that a dataset is made in: whose it is, what of it stands already, and how it is finished."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from isacsim.errors import InputError, RunError
from isacsim.files import claim, remove_partial
from labeling.dataset.dataset import (
    META_FILE,
    ROADS,
    SHARDS,
    Lost,
    Meta,
    Shard,
    read_meta,
    read_shard,
    shard_name,
    write_meta,
)


def fingerprint(*identity: Any) -> str:
    """A digest of everything that a dataset's samples depend on, plain values."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


@contextmanager
def claimed(out: Path, started: Meta) -> Iterator[None]:
    """Hold a folder for one study, begun now or before, against every other study, command and content."""
    with claim(out, META_FILE, "dataset"):
        before = read_meta(out)
        if before is not None and before.fingerprint != started.fingerprint:
            raise InputError(
                f"{out}: holds the dataset of another study ({_difference(before, started)}); choose another folder"
            )
        _prepare(out)
        if before is None:
            write_meta(out, started)
        yield


def _prepare(out: Path) -> None:
    """Make the folder's parts, and clear what a killed command left half-written. Raises InputError."""
    try:
        for folder in (out / SHARDS, out / ROADS):
            if folder.is_symlink():
                raise InputError(f"{folder}: is a link out of the dataset's folder; put the folder itself there")
            folder.mkdir(exist_ok=True)
        remove_partial(out, "*.json")
        remove_partial(out / SHARDS, "*.parquet")
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}); mend that, or choose another folder") from None
    effective = os.access in os.supports_effective_ids
    if not all(os.access(folder, os.W_OK, effective_ids=effective) for folder in (out, out / SHARDS, out / ROADS)):
        raise InputError(f"{out}: is read-only; let the command write there, or choose another folder")


def _difference(before: Meta, now: Meta) -> str:
    """The first setting, scenario or version in which two datasets differ, with both values."""

    def tree(meta: Meta) -> dict[str, Any]:
        inputs = {each.name: each.model_dump(mode="json") for each in meta.scenarios}
        return {**meta.study, "inputs": inputs, "versions": meta.versions, "resensed": meta.resensed or {}}

    return _first_difference("", tree(before), tree(now)) or "its fingerprint differs"


def _first_difference(path: str, before: Any, now: Any) -> str | None:
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*before, *(key for key in now if key not in before)]:
            found = _first_difference(f"{path}.{key}".lstrip("."), before.get(key), now.get(key))
            if found:
                return found
        return None
    return None if before == now else f"{path} is {json.dumps(before)} there and {json.dumps(now)} here"


def standing(out: Path, started: Meta) -> dict[str, Shard]:
    """The shards of this study that stand already, whole, by file."""
    before = read_meta(out)
    known = {shard.file: shard for shard in before.shards} if before else {}

    def whole(path: Path) -> Shard | None:
        shard = known.get(path.name)
        if shard is not None and shard.bytes == path.stat().st_size:
            return shard
        try:
            return read_shard(path)
        except InputError:
            return None

    # Reading them takes most of a core each, and lets go of Python's lock.
    with ThreadPoolExecutor() as threads:
        found = [shard for shard in threads.map(whole, sorted((out / SHARDS).iterdir())) if shard is not None]
    return {
        shard.file: shard
        for shard in found
        if shard.episode.fingerprint == started.fingerprint
        and shard.file == shard_name(shard.episode.scenario, shard.episode.seed)
    }


def finish(
    out: Path, started: Meta, shards: Sequence[Shard], lost: Sequence[Lost] = (), short: Sequence[str] = ()
) -> None:
    """Write the finished `dataset.json` and delete the shards of episodes that turned out not to be needed."""
    if lost and not shards:
        raise RunError(f"all {len(lost)} episodes failed, the first with: {lost[0].reason}")
    kept = {shard.file for shard in shards}
    for path in (out / SHARDS).iterdir():
        if path.name not in kept:
            path.unlink()
    finished = {"complete": True, "shards": tuple(shards), "lost": tuple(lost), "short": tuple(short)}
    write_meta(out, started.model_copy(update=finished))
