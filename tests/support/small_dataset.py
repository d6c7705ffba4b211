"""A small dataset on disk, of drawn states."""

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
    write_meta,
    write_roads,
    write_shard,
)
from isac_cosim.labeling.intentions import Intention

LENGTHS = (200, 50, 20)


def sample(k: int, seed: int = 1) -> Sample:
    rng = np.random.default_rng([seed, k])
    tv, truth, uv, run_in = (rng.normal(size=(6, n)).astype(np.float32) for n in (LENGTHS[0], *LENGTHS))
    intention, origin = Intention(k % 7), ("natural", "reaction", "commanded")[k % 3]
    cause = ("debris", 1.5 + 0.25 * (k % 5)) if origin == "reaction" else ("", float("nan"))
    return Sample(
        f"road-{seed}-{k}", "road", seed, "sumo", f"tv{k}", f"uv{k}", intention, origin, 1.0, 2.0, 3.0, 4.0,
        "isac", 5.5, 4, tv, truth, uv, *cause, run_in, x0=100.0 * k, y0=-20_000.0,
    )  # fmt: skip


def make(folder: Path, counts: tuple[int, ...] = (300, 0, 5)) -> Dataset:
    """A dataset of one shard a count."""
    (folder / "shards").mkdir(parents=True)
    shards = [
        write_shard(
            folder / "shards",
            [sample(k, seed) for k in range(count)],
            Episode(scenario="road", seed=seed, left_out={"no_uv": seed}),
            *LENGTHS,
        )
        for seed, count in enumerate(counts)
    ]
    site = SiteMeta(id="s", x=1.0, y=2.0, height_m=25.0, azimuth_deg=90.0)
    scenario = ScenarioMeta(name="road", source="road", sha256="0" * 64, origin=(0.0, 0.0), sites=(site,))
    meta = Meta(
        complete=True, fingerprint="f", tv_rate_hz=40, uv_rate_hz=10, duration_s=5.0, run_in_s=0.5,
        study={"seeds": [0, 2]}, versions={"numpy": "2"}, scenarios=(scenario,), shards=tuple(shards),
    )  # fmt: skip
    write_meta(folder, meta)
    lanes = [Lane(name, "e", 0, 3.2, 10.0, np.array([[0.0, 1.0], [10.0, 2.5]]), ()) for name in ("e_0", ":j_0")]
    write_roads(folder, "road", lanes)
    return Dataset.open(folder)
