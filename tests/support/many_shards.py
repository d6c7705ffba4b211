"""Indexes of many made-up shards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.labeling.dataset.dataset import Episode, Shard, ShardIndex
from isac_cosim.labeling.dataset.shard_index import SCHEMA


def made_up_shard(seed: int, scenario: str = "road", fingerprint: str = "") -> Shard:
    """An entry with counts that differ from seed to seed."""
    by_intention = {name: n for name, n in (("hard_brake", seed % 3), ("overtake", 2), ("following", seed % 2)) if n}
    return Shard(
        file=f"{scenario}-{seed}.parquet", sha256=f"{seed:064x}", bytes=1000 + seed, samples=sum(by_intention.values()),
        by_intention=by_intention, by_origin={"natural": 2, "commanded": 1 + seed % 4},
        episode=Episode(
            scenario=scenario, seed=seed, fingerprint=fingerprint, events={"hard_brake": 5, "overtake": seed + 1},
            counts={"beyond_car": seed % 2 + 1, f"rare {seed % 5}": 1}, left_out={"no_uv": 3} if seed % 2 else {},
            collided=seed % 3, teleported=1,
        ),
    )  # fmt: skip


def write_many(path: Path, count: int, fingerprint: str) -> ShardIndex:
    """Write the index of the shards of `count` seeds, from 1 on, which are alike, and read it back."""
    ShardIndex.of([made_up_shard(1, fingerprint=fingerprint)]).write(path)
    table = pq.read_table(path).take(pa.array(np.zeros(count, np.int64)))
    seeds = range(1, count + 1)
    columns = {
        "seed": list(seeds),
        "file": [f"road-{k}.parquet" for k in seeds],
        "sha256": [f"{k:064x}" for k in seeds],
    }
    for name, values in columns.items():
        position = SCHEMA.get_field_index(name)
        table = table.set_column(position, SCHEMA.field(name), pa.array(values, SCHEMA.field(name).type))
    pq.write_table(table.cast(SCHEMA), path)
    return ShardIndex.read(path)
