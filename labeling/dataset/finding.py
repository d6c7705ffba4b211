"""Finds episodes and samples of a dataset by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import shortened
from isac_cosim.base.registry import nearest
from isac_cosim.labeling.dataset.dataset import Dataset, Shard, ShardIndex

MOST_LIKE = 10_000
"""Names among which the one is looked for that was meant."""


def find_episode(dataset: Dataset, name: str, with_records: bool = True) -> Shard:
    """Return the shard of an episode, `SCENARIO-SEED`.

    with_records: whether it must have one. Raises InputError if there is no such episode, or if it has no record.
    """
    names = {shard.file.removesuffix(".parquet"): shard for shard in dataset.meta.shards}
    if name not in names:
        hint = nearest(name, names)
        raise InputError(
            f"--episode {shortened(name)}: {dataset.path} has no such episode; {hint}it has {_listed([*names])}"
        )
    if with_records and not names[name].samples:
        others = [other for other, shard in names.items() if shard.samples]
        raise InputError(f"--episode {name}: has no record to show; episodes with records are {_listed(others)}")
    return names[name]


def find_sample(dataset: Dataset, sample_id: str) -> int:
    """Return the row of a sample. Raises InputError if there is none of that name."""
    names = dataset.frame(["sample_id"])["sample_id"].to_numpy()
    rows = np.flatnonzero(names == sample_id)
    if not len(rows):
        hint = nearest(sample_id, names[:MOST_LIKE].tolist()) or f"they are named {_listed(names[:2].tolist())}, ..."
        raise InputError(f"{dataset.path}: has no sample {shortened(sample_id)}; {hint.strip()}")
    return int(rows[0])


def shard_of(dataset: Dataset, row: int) -> tuple[Shard, int]:
    """Return the shard that holds a row of the dataset, and the row within it."""
    ends = np.cumsum(dataset.meta.shards.numbers("samples"))
    number = int(np.searchsorted(ends, row, side="right"))
    shard = dataset.meta.shards[number]
    return shard, row - int(ends[number]) + shard.samples


def of_one(dataset: Dataset, shard: Shard) -> Dataset:
    """Return the dataset with this shard alone."""
    return replace(dataset, meta=dataset.meta.model_copy(update={"shards": ShardIndex.of([shard])}))


def _listed(names: Sequence[str]) -> str:
    """Return the first of some names as a text."""
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return (", ".join(names[:5]) + more) or "none"
