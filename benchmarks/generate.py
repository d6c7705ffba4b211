"""Where the time of one episode goes, what sensing one record takes, and how the making of a dataset scales.

- stages: CPU seconds of one episode of the bundled motorway, 240 s of about 100 vehicles: traffic, labels, candidates,
  motion and sensing of the chosen records, writing.
- record: CPU seconds for 5 s with four sites, 2,000 x 4 snapshots, fusion and filter (`benchmarks.echo`).
- scaling: samples a second of two worker processes over one, and of both over 1, 2, 4 and 8 times the work; the
  parent's memory (`benchmarks.scaling`). Several minutes; it wants two cores to itself.

The first two are on one thread. Run: python -m benchmarks.generate
"""

from __future__ import annotations

import importlib
import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from benchmarks import scaling
from benchmarks.echo import record_s
from isacsim.scenarios.scenario import load
from isacsim.traffic.simulation import record
from labeling.dataset.dataset import Episode, write_shard
from labeling.events import label
from labeling.generation.episode import make_samples, select
from labeling.generation.settings import DatasetStudy
from labeling.road.surroundings import Surroundings
from labeling.samples.candidates import candidates

SCENARIO = "motorway"
SEED = 1


def run() -> dict[str, Any]:
    """Measure.

    Keys `ratio` (samples a second of two workers over one), `scaling` (the rest of it), `traffic_over_episode`,
    `labels_over_traffic`, `stages_s`, `samples_per_s` (of one episode on one thread), `record_s`.
    """
    found = scaling.run()
    with threadpool_limits(1):
        return {"ratio": found.pop("ratio"), "ratio_of": found.pop("ratio_of"), "scaling": found, **_one_episode()}


def _one_episode() -> dict[str, Any]:
    study, scenario = DatasetStudy(scenarios=(SCENARIO,)), load(SCENARIO)
    stages: dict[str, float] = {}
    with _timed(stages, "traffic"):
        recording = record(scenario, SEED, study.traffic, study.maneuvers)
    with _timed(stages, "labels"):
        around = Surroundings(recording)
        labels = label(recording, study.labels, around)
    with _timed(stages, "candidates"):
        found = candidates(recording, labels, study.pairs, study.record, around, study.motion)
    with _timed(stages, "motion_and_sensing"):
        chosen, _ = select(found.samples, study.selection, (scenario.name, SEED))
        samples, _ = make_samples(study, scenario, recording, chosen)
    with _timed(stages, "writing"), tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        lengths = (round(study.record.duration_s * rate) for rate in (study.record.tv_rate_hz, study.record.uv_rate_hz))
        write_shard(Path(folder), samples, Episode(scenario=scenario.name, seed=SEED), *lengths)
    whole = sum(stages.values())
    return {
        "traffic_over_episode": round(stages["traffic"] / whole, 4),
        "labels_over_traffic": round((stages["labels"] + stages["candidates"]) / stages["traffic"], 4),
        "stages_s": {name: round(spent, 3) for name, spent in stages.items()},
        "episode_s": round(whole, 3),
        "samples": len(samples),
        "samples_per_s": round(len(samples) / whole, 2),
        "record_s": {"alone": round(record_s(1), 4), "of_32": round(record_s(32), 4)},
        "settings": {"scenario": SCENARIO, "seed": SEED, "duration_s": study.traffic.duration_s},
    }


@contextmanager
def _timed(stages: dict[str, float], name: str) -> Iterator[None]:
    begin = time.process_time()
    yield
    stages[name] = time.process_time() - begin


if __name__ == "__main__":
    # By its name, so that other processes find what is sent to them.
    print(json.dumps(importlib.import_module("benchmarks.generate").run(), indent=2))
