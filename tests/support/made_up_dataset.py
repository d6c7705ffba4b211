"""The made-up records as a dataset on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.labeling.dataset.dataset import (
    Dataset,
    Episode,
    Meta,
    Sample,
    ScenarioMeta,
    SiteMeta,
    road_digests,
    write_meta,
    write_roads,
    write_shard,
)
from isac_cosim.labeling.dataset.pull_outs import write_dropped_pull_outs
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records
from tests.support.made_up import make_records
from tests.support.made_up_pull_outs import make_pull_outs

SITE = SiteMeta(id="s", x=1.0, y=2.0, height_m=25.0, azimuth_deg=90.0)
STUDY = {"seeds": {"first": 0, "last": 3}}


def write_dataset(
    folder: Path, scenario: str = "toy", seeds: int = 4, per_class: int = 2, passing: bool = False
) -> Dataset:
    """The records of so many seeds; what the TV truly did lies 0.1 in every component beside what was sensed.

    passing: whether it says when pull-outs pass, and holds dropped ones.
    """
    (folder / "shards").mkdir(parents=True)
    records, shards = make_records(seeds, per_class), []
    pull_outs = make_pull_outs(records, seeds, per_class) if passing else None
    answers = {} if pull_outs is None else pull_outs.table.to_dict("index")

    def samples(part: Records, seed: int, mark: str) -> list[Sample]:
        prefix = f"{scenario}-{seed}-{mark}"
        return [
            Sample(
                f"{prefix}{k}", scenario, seed, "kinematic", "tv", "uv", Intention(row.label), "natural",
                row.t_start, row.t_onset, row.t_commit, row.t_commit + 1, "isac", row.snr_db, 4,
                part.tv[row.Index], part.tv[row.Index] + np.float32(0.1), part.uv[row.Index],
                **answers.get(row.sample_id, {}),
            )
            for k, row in enumerate(part.table[part.table["seed"] == seed].itertuples())
        ]  # fmt: skip

    for seed in range(seeds):
        episode, lengths = Episode(scenario=scenario, seed=seed), (2000, 500, 0)
        dropped = [] if pull_outs is None else samples(pull_outs.dropped, seed, "p")
        kept = write_dropped_pull_outs(folder, dropped, episode, lengths)
        shards.append(write_shard(folder / "shards", samples(records, seed, ""), episode, *lengths, kept))
    described = ScenarioMeta(name=scenario, source=scenario, sha256="0" * 64, origin=(0.0, 0.0), sites=(SITE,))
    meta = Meta(
        complete=True, fingerprint="f", tv_rate_hz=400, uv_rate_hz=100, duration_s=5.0, study=STUDY,
        versions={}, scenarios=(described,), shards=tuple(shards),
    )  # fmt: skip
    write_roads(folder, scenario, [Lane("e_0", "e", 0, 3.2, 900.0, np.array([[0.0, 0.0], [900.0, 0.0]]), ())])
    write_meta(folder, meta.model_copy(update={"roads": road_digests(folder, [scenario])}))
    return Dataset.open(folder)
