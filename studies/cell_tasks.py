"""The tasks of a sweep: trainings and evaluations of cells, each of which a worker process can run.

A task opens the dataset that it needs, and holds its records for as long as it runs.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from isac_cosim.base.errors import NO_ROOM, OutputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.workers.engine import Engine, describe
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.report import write_page
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import load_run, read_card
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.sweep_axes import Cell


@dataclass(frozen=True)
class Problem:
    """Why a task failed, in one line. error: the error, if no other task would survive it either."""

    reason: str
    error: OSError | OutputError | None = None


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
    folder to write.
    """

    cell: Cell
    network: str
    dataset: Path
    seeds: tuple[str, ...]
    runs: tuple[Path, ...]
    floors: tuple[Path, ...]
    evaluation: EvaluateSettings
    report: Path

    def work(self) -> None:
        """Evaluate, draw the figures, and write the page, which marks a finished evaluation."""
        dataset = Dataset.open(self.dataset)
        records = Records.of(dataset)
        tested = records.take(np.isin(records.groups, self.seeds))
        run, *others = (load_run(folder) for folder in (*self.runs, *self.floors))
        result = evaluate_records(run, tested, made_of(dataset), self.report, self.evaluation, others)
        draw_figures(result, self.report)
        write_page(result.result, self.report)


def run_tasks(
    tasks: Sequence[Task], engine: Engine, feedback: Feedback, title: str, unit: str, threads: int = 1
) -> Generator[tuple[Task, str]]:
    """Run tasks side by side, and yield those that fail, with the reason.

    title, unit: of the progress bar. threads: that a task uses.
    Raises OutputError or OSError if nothing can be written.
    """
    if not tasks:
        return
    with feedback.bar(title, unit) as move, closing(engine.run(attempt, tasks, threads)) as outcomes:
        move(0, len(tasks))
        for done, outcome in enumerate(outcomes, 1):
            problem = outcome.result
            if problem is not None and problem.error is not None:
                raise problem.error
            move(done, len(tasks))
            reason = outcome.error if problem is None else problem.reason
            if reason is not None:
                yield outcome.item, reason


def attempt(task: CellTask) -> Problem | None:
    """Run a task in a worker, and return what went wrong: unlike a worker that died, it would go wrong again."""
    try:
        task.work()
    except OutputError as error:
        return Problem(describe(error), error)
    except OSError as error:
        return Problem(describe(error), error if error.errno in NO_ROOM else None)
    except Exception as error:
        return Problem(describe(error))
    return None


def made_of(dataset: Dataset) -> dict[str, object]:
    """Return what results record of the dataset that they come from."""
    return {"digest": dataset.digest, "study": dataset.meta.study}
