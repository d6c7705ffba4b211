"""The tasks of a sweep: trainings and evaluations of cells, each of which a worker process can run.

A task opens the dataset that it needs, and holds its records for as long as it runs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar
from urllib.parse import quote

import numpy as np

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.shortages import shortage
from isac_cosim.base.workers.attempts import Outcome, describe
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.missing import Tally, run_missing
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.page import PAGE
from isac_cosim.evaluation.report.parts import Link
from isac_cosim.evaluation.report.report import write_page
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.data.sides import dependence_of_test
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import load_run, read_card
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.sweep_axes import Cell


class CellTask(Protocol):
    """A part of a cell that a worker process runs."""

    def work(self) -> None:
        """Do it; what an earlier command finished is kept."""


Task = TypeVar("Task", bound=CellTask)


@dataclass(frozen=True)
class CellTraining:
    """A training of a cell.

    dataset: folder of the dataset. sides: scenario seeds to train, validate and test on. run: folder of the predictor.
    """

    cell: Cell
    dataset: Path
    sides: dict[str, list[str]]
    training: TrainSettings
    run: Path

    def is_finished(self, digest: str) -> bool:
        """Return whether the folder holds this very training. digest: of the dataset."""
        card = read_card(self.run)
        if card is None or not card.complete:
            return False
        return (card.settings, card.split, card.dataset.get("digest")) == (self.training, self.sides, digest)

    def work(self) -> None:
        """Train, or go on from the last epoch."""
        dataset = Dataset.open(self.dataset)
        train_records(Records.of(dataset), made_of(dataset), self.run, self.training, sides=self.sides)


@dataclass(frozen=True)
class CellEvaluation:
    """The evaluation of a cell's predictors on the test seeds of a network, beside those of the floor.

    dataset: folder of that network's dataset. seeds: its test seeds. runs, floors: folders of the predictors. report:
    folder to write. table: that of the sweep's page, to which this one links.
    """

    cell: Cell
    network: str
    dataset: Path
    seeds: tuple[str, ...]
    runs: tuple[Path, ...]
    floors: tuple[Path, ...]
    evaluation: EvaluateSettings
    report: Path
    table: Path

    def work(self) -> None:
        """Evaluate, draw the figures, and write the page, which marks a finished evaluation."""
        dataset = Dataset.open(self.dataset)
        records = Records.of(dataset)
        tested = records.take(np.isin(records.groups, self.seeds))
        run, *others = (load_run(folder) for folder in (*self.runs, *self.floors))
        twins = dependence_of_test(dataset, records, run.card.split, run.card.settings.split)
        result = evaluate_records(run, tested, made_of(dataset), self.report, self.evaluation, others, dependence=twins)
        draw_figures(result, self.report)
        target = quote(Path(os.path.relpath(self.table / PAGE, self.report)).as_posix())
        write_page(result.result, self.report, above=[Link("table of the sweep", target)])


def run_tasks(
    tasks: Sequence[Task],
    engine: Engine,
    feedback: Feedback,
    title: str,
    unit: str,
    failed: Callable[[Task, str], None],
    threads: int = 1,
) -> None:
    """Run tasks side by side.

    title, unit: of the progress bar. failed: called with each task that fails, and why. threads: that a task uses.
    Raises OutputError if nothing can be written, ShortageError if the machine lacks something.
    """
    tally = Tally(len(tasks))

    def keep(outcome: Outcome[Task, None]) -> None:
        tally.done += 1
        if outcome.error is not None:
            failed(outcome.item, outcome.error)

    if tasks:
        run_missing(
            attempt, tasks, engine, feedback, title=title, unit=unit, keep=keep, progress=tally, threads=threads
        )


def attempt(task: CellTask) -> None:
    """Run a task in a worker.

    Raises RunError where it fails: unlike a worker that died, it would fail again, but other cells may not.
    """
    try:
        task.work()
    except Exception as error:
        raise shortage(error) or RunError(describe(error)) from None


def made_of(dataset: Dataset) -> dict[str, object]:
    """Return what results record of the dataset that they come from."""
    return {"digest": dataset.digest, "study": dataset.meta.study}
