"""How much memory the records of a dataset take, and how fast windows come, with states in memory and on disk.

A dataset of made-up records is written, in shards of 250 samples. Then, each time in a new process, its records are
opened and the windows of some epochs are cut in a drawn order, in batches of 32: in turn with all states in memory and
with all states on disk (`models.data.states`). What a network does with the windows is not part of it; in a training,
the difference is smaller by its share. Speeds are windows per CPU second of the process.

With more records than fit into the memory, measure the second alone.
Linux only, because the memory is read from /proc.

Run: python -m isac_cosim.benchmarks.findings.large_dataset [SAMPLES, 4000 if not given] [--disk-only]
"""

from __future__ import annotations

import importlib
import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.files import json_text
from isac_cosim.base.seeding import stream
from isac_cosim.benchmarks.findings.memory import QUANTITIES, peaks, sampled
from isac_cosim.labeling.dataset.dataset import (
    Dataset,
    Episode,
    Meta,
    Sample,
    ScenarioMeta,
    Shard,
    ShardIndex,
    SiteMeta,
    write_meta,
    write_shard,
)
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Records, WindowSettings, batches, draw_ends

SCENARIO = "made_up"
PER_SHARD = 250
BATCH = 32
ROUNDS = 3
EPOCHS = 2
TV, UV = 2000, 500
"""Samples of the TV and of the UV in a record."""
LIMITS = {"memory": sys.maxsize, "disk": 0}
"""Bytes of states that may be in memory, of each kind."""


def run(samples: int = 4000, kinds: tuple[str, ...] = ("memory", "disk")) -> dict[str, Any]:
    """Measure.

    Returns, by kind, the seconds of CPU time that it takes to open the records, `windows_per_s`, and the peaks of the
    process's memory before and after in MiB; and `ratio`, the windows per second from disk over those from memory.
    """
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        write_made_up(Path(folder), samples)
        stored_bytes = sum(path.stat().st_size for path in Path(folder).rglob("*"))
        with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=1) as fresh:
            rounds = [{kind: fresh.submit(measure, folder, kind).result() for kind in kinds} for _ in range(ROUNDS)]
    medians = {
        kind: {name: float(np.median([of_round[kind][name] for of_round in rounds])) for name in rounds[0][kind]}
        for kind in kinds
    }
    result: dict[str, Any] = {**medians, "samples": samples, "stored_mib": round(stored_bytes / 2**20)}
    if len(kinds) == 2:
        speeds = [of_round["disk"]["windows_per_s"] / of_round["memory"]["windows_per_s"] for of_round in rounds]
        result |= {"ratio": round(float(np.median(speeds)), 3), "ratio_of": "windows per second, from disk over memory"}
    return result


def measure(folder: str, kind: str) -> dict[str, float]:
    """Open the records of a dataset and cut the windows of some epochs. kind: of `LIMITS`."""
    dataset, settings = Dataset.open(folder), WindowSettings()
    with sampled() as before:
        pass
    with sampled() as during:
        begin = time.process_time()
        records = Records.of(dataset, in_memory_bytes=LIMITS[kind])
        opened = time.process_time()
        took = 0.0
        count = 0
        for epoch in range(EPOCHS):
            ends = draw_ends(records, settings, "benchmark", epoch)
            ends = ends[stream("benchmark order", epoch).permutation(len(ends))]
            cutting = time.process_time()
            count += sum(len(windows) for windows in batches(records, ends, settings, BATCH))
            took += time.process_time() - cutting
    idle, peak = peaks(before), peaks(during)
    return {
        "open_s": round(opened - begin, 2),
        "windows_per_s": round(count / took, 1),
        **{f"{name}_before": idle[name] for name in QUANTITIES},
        **{name: max(idle[name], peak[name]) for name in QUANTITIES},
    }


def write_made_up(folder: Path, samples: int) -> None:
    """Write a dataset of so many records, whose states are noise."""
    (folder / "shards").mkdir()
    rng = np.random.default_rng(1)
    # Three digits, as measured values have them; else Parquet would store noise.
    noise = [np.round(rng.standard_normal((PER_SHARD, 6, n)), 3).astype(np.float32) for n in (TV, UV)]
    shards = [
        _write_shard(folder, seed, min(PER_SHARD, samples - first), *noise)
        for seed, first in enumerate(range(0, samples, PER_SHARD))
    ]
    site = SiteMeta(id="s", x=0.0, y=0.0, height_m=25.0, azimuth_deg=90.0)
    scenario = ScenarioMeta(name=SCENARIO, source=SCENARIO, sha256="0" * 64, origin=(0.0, 0.0), sites=(site,))
    meta = Meta(
        complete=True, fingerprint="made up", tv_rate_hz=400.0, uv_rate_hz=100.0, duration_s=5.0, study={},
        versions={}, scenarios=(scenario,), shards=ShardIndex.of(shards),
    )  # fmt: skip
    write_meta(folder, meta)


def _write_shard(folder: Path, seed: int, count: int, tv: np.ndarray[Any, Any], uv: np.ndarray[Any, Any]) -> Shard:
    rows = [
        Sample(
            f"{SCENARIO}-{seed}-{k}", SCENARIO, seed, "kinematic", "tv", "uv", Intention(KNOWN[k % len(KNOWN)]),
            "natural", 100.0, 102.6, 103.6, 104.6, "isac", 5.0, 4, tv[k], tv[k], uv[k],
        )
        for k in range(count)
    ]  # fmt: skip
    return write_shard(folder / "shards", rows, Episode(scenario=SCENARIO, seed=seed), TV, UV)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--disk-only"]
    kinds = ("disk",) if "--disk-only" in sys.argv else ("memory", "disk")
    # Imported by name, so that other processes find the functions that are sent to them.
    module = importlib.import_module("isac_cosim.benchmarks.findings.large_dataset")
    print(json_text(module.run(*map(int, words[:1]), kinds=kinds), 2))
