"""The folder that a dataset is generated in: whose it is, what it holds already, and how it is finished."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.files import claim, remove_partial
from isac_cosim.base.workers.attempts import DIED
from isac_cosim.labeling.dataset.dataset import (
    DROPPED_PULL_OUTS,
    INDEX_FILE,
    META_FILE,
    ROADS,
    SHARDS,
    Lost,
    Meta,
    read_description,
    road_digests,
    write_meta,
)
from isac_cosim.labeling.generation.journal import Journal
from isac_cosim.labeling.publication.card import README_FILE
from isac_cosim.labeling.publication.describing import write_descriptions


def fingerprint(*identity: Any) -> str:
    """Return a digest of plain values: everything that a dataset's samples depend on."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


@contextmanager
def claimed(out: Path, started: Meta, unused: Container[str] = ()) -> Iterator[Meta]:
    """Lock a folder for one study, which begins there now or has begun there before.

    started: the unfinished `dataset.json` of the study; yielded with the fingerprint that the folder's shards have.
    unused: sections that earlier versions stored although its motion does not come from there. Raises InputError if the
    folder holds anything else, another study included, or another command uses it.
    """
    with claim(out, META_FILE, "dataset"):
        before = read_description(out)
        if before is not None and before.schema_version != started.schema_version:
            raise InputError(
                f"{out}: holds a dataset of schema version {before.schema_version}, and this version writes "
                f"{started.schema_version}; choose another folder, or finish it with the version that began it"
            )
        if before is not None and unused and _identity(before, unused) == _identity(started, unused):
            started = started.model_copy(update={"fingerprint": before.fingerprint})
        elif before is not None and before.fingerprint != started.fingerprint:
            for scenario in started.scenarios:
                stored = next((former.inputs for former in before.scenarios if former.name == scenario.name), {})
                if changed := changed_input(stored, scenario.inputs):
                    raise InputError(
                        f"{out}: holds a dataset, and {changed} of {scenario.name} has changed since it "
                        "was begun; restore it, or choose another folder"
                    )
            raise InputError(
                f"{out}: holds the dataset of another study ({_difference(before, started)}); choose another folder"
            )
        _prepare(out)
        if before is None:
            write_meta(out, started)
        yield started


def _identity(meta: Meta, unused: Container[str]) -> Any:
    """Return what the samples of a dataset depend on; the name of its world is not part of it."""
    study = {key: value for key, value in meta.study.items() if key != "world" and key not in unused}
    scenarios = [scenario.identity for scenario in meta.scenarios]
    return study, scenarios, meta.schema_version, meta.versions, meta.resensed


def changed_input(before: Mapping[str, str], now: Mapping[str, str]) -> str | None:
    """Return the first of the inputs of recordings that has another digest now, by its name; None if all are equal.

    Nothing is known to have changed where no digests were stored.
    """
    names = [*before, *(name for name in now if name not in before)] if before else ()
    return next((name for name in names if before.get(name) != now.get(name)), None)


def _prepare(out: Path) -> None:
    """Create the folders inside, and delete the temporary files of killed commands. Raises InputError."""
    try:
        for folder in (out / SHARDS, out / ROADS, out / DROPPED_PULL_OUTS):
            if folder.is_symlink():
                raise InputError(
                    f"{folder}: is a link that leads out of the dataset's folder; replace it with a folder"
                )
            if folder.name != DROPPED_PULL_OUTS:
                folder.mkdir(exist_ok=True)
        remove_partial(out, "*.json")
        remove_partial(out, INDEX_FILE)
        remove_partial(out, README_FILE)
        for folder in (out / SHARDS, out / DROPPED_PULL_OUTS):
            remove_partial(folder, "*.parquet")
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}); fix that, or choose another folder") from None
    effective = os.access in os.supports_effective_ids
    if not all(os.access(folder, os.W_OK, effective_ids=effective) for folder in (out, out / SHARDS, out / ROADS)):
        raise InputError(f"{out}: is read-only; make it writable, or choose another folder")


def _difference(before: Meta, now: Meta) -> str:
    """Return the first setting, scenario or version in which two datasets differ, with both values."""

    def tree(meta: Meta) -> dict[str, Any]:
        inputs = {scenario.name: scenario.model_dump(mode="json") for scenario in meta.scenarios}
        return {**meta.study, "inputs": inputs, "versions": meta.versions, "resensed": meta.resensed or {}}

    return _first_difference("", tree(before), tree(now)) or "its fingerprint differs"


def _first_difference(path: str, before: Any, now: Any) -> str | None:
    """Return the first difference between two trees of plain values, None if they are equal."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*before, *(key for key in now if key not in before)]:
            difference = _first_difference(f"{path}.{key}".lstrip("."), before.get(key), now.get(key))
            if difference:
                return difference
        return None
    return None if before == now else f"{path} is {json.dumps(before)} there and {json.dumps(now)} here"


def finish(
    out: Path,
    started: Meta,
    journal: Journal,
    files: Iterable[str],
    lost: Sequence[Lost] = (),
    short: Sequence[str] = (),
) -> None:
    """Write the index, the finished `dataset.json` and what is made from it; delete the shards that are not needed.

    journal: the entries of the folder's shards. files: names of the shards that belong to the dataset, in its order.
    lost: episodes that failed. short: known intentions with too few samples. Raises RunError if all episodes failed,
    InputError if each of them ended its process.
    """
    shards = journal.shards.select(files)
    if lost and not shards:
        if all(episode.reason.startswith(DIED) for episode in lost):
            first = f"{lost[0].scenario}, seed {lost[0].seed}: {lost[0].reason}"
            raise InputError(f"all {len(lost)} episodes crashed, the first is {first}; fix the scenario's files")
        raise RunError(f"all {len(lost)} episodes failed, the first with: {lost[0].reason}")
    kept = set(shards.files)
    for path in (*(out / SHARDS).iterdir(), *(out / DROPPED_PULL_OUTS).glob("*")):
        if path.name not in kept:
            path.unlink()
    update = {
        "complete": True,
        "shards": shards,
        "roads": road_digests(out, [scenario.name for scenario in started.scenarios]),
        "lost": tuple(lost),
        "short": tuple(short),
    }
    finished = started.model_copy(update=update)
    write_meta(out, finished)
    write_descriptions(out, finished)
    journal.remove()
