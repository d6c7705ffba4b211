"""Dropped pull-outs: records of pull-outs that are in no class, kept beside a dataset's samples.

A pull-out that passed the UV without returning, or whose outcome the recording does not resolve, is neither an overtake
nor a lane change. It still shows whether the TV passes the UV. These records have shards of their own, in a folder of
their own, so that whoever reads the dataset does not take them for samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, Dataset, ShardIndex
from isac_cosim.labeling.dataset.shard import Episode, Sample, Shard, pull_outs_digest, read_shard, write_shard


def dropped_pull_outs(dataset: Dataset) -> Dataset:
    """Return the dropped pull-outs as a dataset of their own, which is empty where there are none.

    Raises InputError if their shards are missing or damaged.
    """
    entries = (dropped_pull_outs_of(dataset, shard) for shard in dataset.meta.shards)
    shards = ShardIndex.of(shard for shard in entries if shard is not None)
    return replace(dataset, meta=dataset.meta.model_copy(update={"shards": shards}), folder=DROPPED_PULL_OUTS)


def dropped_pull_outs_of(dataset: Dataset, shard: Shard) -> Shard | None:
    """Return the entry of the shard of dropped pull-outs that belongs to a shard; None if there is none.

    Raises InputError if it is missing or damaged.
    """
    digest = pull_outs_digest(dataset.checked_path(shard))
    if digest is None:
        return None
    path = dataset.path / DROPPED_PULL_OUTS / shard.file
    if path.is_file():
        stored = read_shard(path)
        if stored.sha256 == digest:
            return stored
    raise InputError(
        f"{path}: is missing or damaged; delete {dataset.shard_path(shard)} and run the same "
        f"`{dataset.meta.maker}` again"
    )


def write_dropped_pull_outs(
    folder: Path, samples: Sequence[Sample], episode: Episode, lengths: tuple[int, int, int]
) -> Shard | None:
    """Write an episode's dropped pull-outs into a dataset's folder, and return their entry; None without any.

    lengths: numbers of states, as in `labeling.dataset.shard.schema`. Raises OutputError if the file cannot be written.
    """
    if not samples:
        return None
    target = folder / DROPPED_PULL_OUTS
    target.mkdir(exist_ok=True)
    # What the episode counts belongs to its samples.
    alone = Episode(scenario=episode.scenario, seed=episode.seed, fingerprint=episode.fingerprint)
    return write_shard(target, samples, alone, *lengths)
