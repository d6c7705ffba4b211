"""Measures where the time of an episode goes, the cost of sensing a record, and how generation scales.

- stages: CPU seconds of one episode of the bundled motorway, 240 s of about 100 vehicles: traffic, labels, candidates,
  motion and sensing of the chosen records, writing.
- record: CPU seconds for 5 s with four sites, 2,000 x 4 snapshots, fusion and filter (`benchmarks.echo`).
- scaling: samples per second of two worker processes over one; of two workers with 1, 2, 4 and 8 times the work; and
  the parent's memory (`benchmarks.scaling`). This takes several minutes and needs two idle cores.

The first two run on one thread. Run: python -m isac_cosim.benchmarks.generate
"""

from __future__ import annotations

import importlib
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from isac_cosim.base.files import json_text
from isac_cosim.benchmarks import scaling
from isac_cosim.benchmarks.echo import record_s
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.dataset.dataset import Episode, write_shard
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.episode import make_samples, ready
from isac_cosim.labeling.generation.selection import draws
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import candidates

SCENARIO = "motorway"
SEED = 1
RATIOS = (
    Ratio(("ratio",), "samples a second of two workers over one", "the two cores"),
    Ratio(("traffic_over_episode",), "simulation's share of an episode's time", "SUMO's own stepping"),
    Ratio(("labels_over_traffic",), "labels and candidates over the simulation", "motion relative to the road"),
)


def run() -> dict[str, Any]:
    """Run the benchmark.

    Returns the keys `ratio` (samples per second of two workers over one), `ratio_of`, `scaling` (all other results of
    `benchmarks.scaling`), `traffic_over_episode`, `labels_over_traffic`, `stages_s`, `episode_s`, `samples`,
    `samples_per_s` (of one episode on one thread), `record_s` and `settings`.
    """
    scaled = scaling.run()
    with threadpool_limits(1):
        return {"ratio": scaled.pop("ratio"), "ratio_of": scaled.pop("ratio_of"), "scaling": scaled, **_one_episode()}


def _one_episode() -> dict[str, Any]:
    """Return the results of one episode on one thread."""
    study, scenario = DatasetStudy(scenarios=(SCENARIO,)), load(SCENARIO)
    # Done once a process, by the first episode: half a second that is not one of each episode.
    ready()
    stages: dict[str, float] = {}
    with _timed(stages, "traffic"):
        recording = record(scenario, SEED, study.of(TrafficSettings), study.of(ManeuverSettings))
    with _timed(stages, "labels"):
        around = Surroundings(recording)
        labels = label(recording, study.labels, around)
    with _timed(stages, "candidates"):
        available = candidates(recording, labels, study.pairs, study.record, around, study.motion)
    with _timed(stages, "motion_and_sensing"):
        drawn = draws(available.samples, study.selection, (scenario.name, SEED))
        sensor = watch_episode(study, scenario, SEED, recording)
        samples = make_samples(study, recording, drawn, sensor).samples
    with _timed(stages, "writing"), tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        rates_hz = (study.record.tv_rate_hz, study.record.uv_rate_hz)
        tv_length, uv_length = (round(study.record.duration_s * rate_hz) for rate_hz in rates_hz)
        write_shard(Path(folder), samples, Episode(scenario=scenario.name, seed=SEED), tv_length, uv_length)
    episode_s = sum(stages.values())
    return {
        "traffic_over_episode": round(stages["traffic"] / episode_s, 4),
        "labels_over_traffic": round((stages["labels"] + stages["candidates"]) / stages["traffic"], 4),
        "stages_s": {name: round(seconds, 3) for name, seconds in stages.items()},
        "episode_s": round(episode_s, 3),
        "samples": len(samples),
        "samples_per_s": round(len(samples) / episode_s, 2),
        "record_s": {"alone": round(record_s(1), 4), "of_32": round(record_s(32), 4)},
        "settings": {"scenario": SCENARIO, "seed": SEED, "duration_s": study.of(TrafficSettings).duration_s},
    }


@contextmanager
def _timed(stages: dict[str, float], name: str) -> Iterator[None]:
    """Add the processor time of the block to the stages, s."""
    begin = time.process_time()
    yield
    stages[name] = time.process_time() - begin


if __name__ == "__main__":
    # Imported by name, so that other processes find the functions that are sent to them.
    print(json_text(importlib.import_module("isac_cosim.benchmarks.generate").run(), 2))
