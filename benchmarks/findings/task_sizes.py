"""What a task sends through a dask scheduler, and what comes back, in bytes: for every command that takes `--cluster`.

Tasks are made as the commands make them, for 1,000 traffic seeds of the bundled motorway with default settings, and
serialised as dask does it. Nothing is run: what comes back is made up, as large as on the motorway.

Run: python -m isac_cosim.benchmarks.findings.task_sizes
"""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Generator, Iterable
from pathlib import Path

from distributed.protocol.pickle import dumps

from isac_cosim.base.files import json_text
from isac_cosim.base.workers.attempts import Attempt, Item, Outcome, Result, try_task
from isac_cosim.benchmarks.cluster import SCENARIO, synthetic_shard
from isac_cosim.benchmarks.findings.large_dataset import write_made_up
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import EpisodeTask, Predictors, ProcessorTime
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.dataset.dataset import Dataset, ShardIndex, read_meta, write_roads
from isac_cosim.labeling.generation.generate import EpisodeResult, generate
from isac_cosim.labeling.generation.resense import ResenseSettings, resense
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.cell_tasks import CellTraining, attempt
from isac_cosim.studies.reproduction.experiments.trainings import Measure, Scores, WindowTraining, train_and_measure
from isac_cosim.studies.sweep_axes import Cell, WayOfSensing

SEEDS = 1000


class MeasuredError(Exception):
    """Carries the size of a task instead of running it."""


class Measuring:
    """An engine that measures the first task and runs none."""

    workers = cores = 1

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        raise MeasuredError(size(try_task, task, next(iter(items))))
        yield


def run() -> dict[str, dict[str, int]]:
    """Return `task_bytes` and `result_bytes` by command."""
    with tempfile.TemporaryDirectory(prefix="cosim-") as name:
        folder = Path(name)
        dataset = made_up(folder / "made_up")
        sensed = sent(lambda: resense(dataset, ResenseSettings(), folder / "sensed", Measuring()))
        study = DatasetStudy(scenarios=(SCENARIO,), seeds=SeedRange(first=1, last=SEEDS))
        generated = sent(lambda: generate(study, folder / "data", Measuring()))
    shard = synthetic_shard(1)
    groups = [f"{SCENARIO}-{seed}" for seed in range(1, SEEDS + 1)]
    sides = {"train": groups[:600], "validation": groups[600:750], "test": groups[750:]}
    cell, training = Cell(SCENARIO, WayOfSensing("isac", "0:10"), "asi-bip"), TrainSettings()
    swept = CellTraining(cell, folder / "data", sides, training, folder / "seed-0")
    live = EpisodeTask(
        LiveStudy(dataset=study, development=SeedRange(first=SEEDS + 1, last=SEEDS + 8)),
        motion_source(study),
        SCENARIO,
        Predictors(folder / "run", {}),
        "0" * 64,
        folder,
    )
    measures = tuple(Measure(name=f"condition {k}", dataset=folder / "data") for k in range(4))
    scores_file, dataset_folder, run_folder = folder / "scores.json", folder / "data", folder / "run"
    reproduced = WindowTraining("asi-bip 0", scores_file, dataset_folder, sides, training, run_folder, measures)
    counts = {group: [[7] * 6] * 6 for group in sides["test"]}
    scores = Scores(
        name="asi-bip 0", training_seed=0, counts={measure.name: counts for measure in measures},
        windows={measure.name: 5000 for measure in measures},
    )  # fmt: skip
    return {
        "generate": _sizes(generated, EpisodeResult(shard, None)),
        "sense": _sizes(sensed, shard),
        "run, a training of a sweep": _sizes(size(try_task, attempt, swept), None),
        "evaluate --traffic": _sizes(size(try_task, live, 1), ProcessorTime(1, *(1.5 for _ in range(7)))),
        "reproduce, a training": _sizes(size(try_task, train_and_measure, reproduced), scores),
    }


def sent(command: Callable[[], object]) -> int:
    """Return the size of the first task that a command sends, bytes."""
    try:
        command()
    except MeasuredError as measured:
        return int(measured.args[0])
    raise RuntimeError("the command sent no task")


def size(*parts: object) -> int:
    """Return the size of an object as dask sends it, bytes."""
    return len(dumps(parts))


def _sizes(task_bytes: int, result: object) -> dict[str, int]:
    return {"task_bytes": task_bytes, "result_bytes": size(Attempt(result, None, 1.0))}


def made_up(folder: Path) -> Dataset:
    """Describe a dataset of SEEDS shards, which are not there."""
    folder.mkdir()
    write_made_up(folder, 4)
    meta = read_meta(folder)
    assert meta is not None
    scenario = meta.scenarios[0].model_copy(update={"name": SCENARIO})
    shards = ShardIndex.of(synthetic_shard(seed) for seed in range(1, SEEDS + 1))
    write_roads(folder, SCENARIO, ())
    return Dataset(folder, meta.model_copy(update={"scenarios": (scenario,), "shards": shards}))


if __name__ == "__main__":
    print(json_text(importlib.import_module("isac_cosim.benchmarks.findings.task_sizes").run(), 2))
