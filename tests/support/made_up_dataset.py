"""The made-up records as a dataset on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from isacsim.scenarios.lane import Lane
from labeling.dataset.dataset import (
    Dataset,
    Episode,
    Meta,
    Sample,
    ScenarioMeta,
    SiteMeta,
    write_meta,
    write_roads,
    write_shard,
)
from labeling.intentions import Intention
from tests.support.made_up import make_records

SITE = SiteMeta(id="s", x=1.0, y=2.0, height_m=25.0, azimuth_deg=90.0)
STUDY = {"seeds": [0, 3]}


def write_dataset(folder: Path, scenario: str = "toy", seeds: int = 4, per_class: int = 2) -> Dataset:
    """The records of so many seeds; what the TV truly did lies 0.1 in every component beside what was sensed."""
    (folder / "shards").mkdir(parents=True)
    records = make_records(seeds, per_class)
    table, shards = records.table, []
    for seed in range(seeds):
        rows = [
            Sample(
                f"{scenario}-{seed}-{k}", scenario, seed, "kinematic", "tv", "uv", Intention(row.label), "natural",
                row.t_start, row.t_onset, row.t_commit, row.t_commit + 1, "isac", row.snr_db, 4,
                records.tv[row.Index], records.tv[row.Index] + np.float32(0.1), records.uv[row.Index],
            )
            for k, row in enumerate(table[table["seed"] == seed].itertuples())
        ]  # fmt: skip
        shards.append(write_shard(folder / "shards", rows, Episode(scenario=scenario, seed=seed), 2000, 500))
    described = ScenarioMeta(name=scenario, source=scenario, sha256="0" * 64, origin=(0.0, 0.0), sites=(SITE,))
    meta = Meta(
        complete=True, fingerprint="f", tv_rate_hz=400, uv_rate_hz=100, duration_s=5.0, study=STUDY,
        versions={}, scenarios=(described,), shards=tuple(shards),
    )  # fmt: skip
    write_meta(folder, meta)
    write_roads(folder, scenario, [Lane("e_0", "e", 0, 3.2, 900.0, np.array([[0.0, 0.0], [900.0, 0.0]]), ())])
    return Dataset.open(folder)
