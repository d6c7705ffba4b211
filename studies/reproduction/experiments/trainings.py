"""Trainings of a stage, run side by side: each leaves one small file of scores, and is not run again.

    OUT/work/runs/<run>/               the trained predictor, with its checkpoints
    OUT/work/scores/<stage>/<name>.json    its scores

A training that was killed resumes from its last epoch.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, TypeVar

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Sealed, Settings, read_json, write_sealed
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.missing import Tally, run_missing
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.on_windows.metrics import confusion
from isac_cosim.evaluation.on_windows.predictions import Predictions, predict
from isac_cosim.evaluation.statistics import Counts
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.data.windows import Records, WindowSettings, draw_ends
from isac_cosim.models.networks.checkpoints import HISTORY_FILE
from isac_cosim.models.runs.run import Run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.cell_tasks import made_of
from isac_cosim.studies.reproduction.experiments.stage_results import Count, is_square
from isac_cosim.studies.reproduction.experiments.unknown_class import UnknownScores, unknown_scores

EPOCH = frozenset({"epoch", "train_loss", "validation_loss", "validation_macro_f1", "validation_accuracy"})
"""What is drawn of an epoch."""
EVALUATION_SEED = 0
"""Seed of the ends of measured windows: the same in every condition, so that conditions share their windows."""


class Measure(Settings):
    """Windows that a trained predictor is measured on, one of each record.

    name: of the condition. dataset: folder of the records. side: of the split that they belong to. relative_to,
    end_after_s: where the windows end, as in `WindowSettings`; as in training when None.
    """

    name: str
    dataset: Path
    side: Literal["validation", "test"] = "test"
    relative_to: Literal["onset", "commit"] | None = None
    end_after_s: tuple[float, float] | None = None


Size = Annotated[float, Field(ge=0)]


class Scores(Settings):
    """What one training of a predictor measured.

    name: of the training. training_seed: its seed. counts: confusion matrices of the known intentions, by measure and
    test seed. windows: number of windows by measure, `following` included. parameters, best_epoch: of a network, None
    otherwise. cpu_s: processor time of the training, s; 0 where an earlier command had trained it. window_ms: time of
    one prediction, ms. unknown: separation of `following`, where it was measured. history: of a network, its scores by
    epoch.
    """

    name: str
    training_seed: Seed
    counts: dict[str, dict[str, Counts]]
    windows: dict[str, Count]
    parameters: Annotated[int, Field(ge=0)] | None = None
    best_epoch: Annotated[int, Field(ge=0)] | None = None
    cpu_s: Size = 0.0
    window_ms: Size | None = None
    unknown: UnknownScores | None = None
    history: list[dict[str, float]] | None = None

    @model_validator(mode="after")
    def _sound(self) -> Self:
        matrices = [matrix for measure in self.counts.values() for matrix in measure.values()]
        if any(not is_square(matrix) or len(matrix) != len(matrices[0]) for matrix in matrices):
            raise ValueError("counts: are not confusion matrices of the same classes")
        if self.history is not None and not (self.history and all(epoch.keys() >= EPOCH for epoch in self.history)):
            raise ValueError(f"history: has epochs without {', '.join(sorted(EPOCH))}, or none")
        return self

    @property
    def classes(self) -> int | None:
        """Number of classes of the confusion matrices, None where there are none."""
        return next((len(matrix) for measure in self.counts.values() for matrix in measure.values()), None)


class StoredScores(Scores, Sealed):
    """The file of a training's scores. schema_version: 1 in files of version 0.2, which have no digest."""

    sealed_since: ClassVar[int] = 2

    schema_version: Literal[1, 2] = 1

    @property
    def scores(self) -> Scores:
        """The scores alone."""
        return Scores.model_validate(self.model_dump(include=set(Scores.model_fields)))


class Task(Protocol):
    """A training that leaves a file of scores."""

    @property
    def name(self) -> str:
        """The name of the training."""

    @property
    def scores_file(self) -> Path:
        """The file that its scores are written to."""


AnyTask = TypeVar("AnyTask", bound=Task)


@dataclass(frozen=True)
class WindowTraining:
    """A predictor to train on a dataset and to measure.

    dataset: folder that it is trained on. sides: scenario seeds to train, validate and test on. run: folder of the
    predictor; tasks that share it train once. measures: what is measured. unknown: whether the separation of
    `following` is measured on the first of them. history: whether the scores by epoch are kept.
    """

    name: str
    scores_file: Path
    dataset: Path
    sides: dict[str, list[str]]
    training: TrainSettings
    run: Path
    measures: tuple[Measure, ...]
    unknown: bool = False
    history: bool = False


def run_tasks(
    work: Callable[[AnyTask], Scores], tasks: Sequence[AnyTask], engine: Engine, feedback: Feedback, title: str
) -> list[Scores]:
    """Run the tasks that have no scores yet; return the scores of all of them, in order.

    work: runs one task in a worker process. title: of the progress bar. Raises RunError where a task fails, InputError
    where a file of scores is damaged or another training's.
    """
    scores = {task.name: _stored(task) for task in tasks}
    missing = [task for task in tasks if scores[task.name] is None]
    if missing:
        for task in missing:
            task.scores_file.parent.mkdir(parents=True, exist_ok=True)
        tally = Tally(len(tasks), len(tasks) - len(missing))

        def keep(outcome: Outcome[AnyTask, Scores]) -> None:
            if outcome.result is None:
                raise RunError(f"{outcome.item.name}: {outcome.error}")
            write_sealed(outcome.item.scores_file, StoredScores(schema_version=2, **dict(outcome.result)))
            scores[outcome.item.name] = outcome.result
            tally.done += 1

        run_missing(work, missing, engine, feedback, title=title, unit="trainings", keep=keep, progress=tally)
    return [result for task in tasks if (result := scores[task.name]) is not None]


def _stored(task: Task) -> Scores | None:
    """Return the scores in a task's file, None where it has none yet."""
    try:
        stored = read_json(StoredScores, task.scores_file)
        if stored is not None and stored.name != task.name:
            raise InputError(f"{task.scores_file}: name: is {stored.name!r}, not {task.name!r}")
    except InputError as error:
        raise InputError(f"{error}; delete the file, and run the same command again") from None
    return None if stored is None else stored.scores


@limited()
def train_and_measure(task: WindowTraining) -> Scores:
    """Train a predictor, unless its folder holds it already, and measure it."""
    dataset = Dataset.open(task.dataset)
    records = Records.of(dataset)
    began = time.process_time()
    task.run.parent.mkdir(parents=True, exist_ok=True)
    run = train_records(records, made_of(dataset), task.run, task.training, sides=task.sides)
    cpu_s = time.process_time() - began
    counts: dict[str, dict[str, Counts]] = {}
    windows: dict[str, int] = {}
    window_ms: float | None = None
    unknown: UnknownScores | None = None
    for number, measure in enumerate(task.measures):
        measured = records if measure.dataset == task.dataset else Records.of(Dataset.open(measure.dataset))
        side = measured.take(np.isin(measured.groups, task.sides[measure.side]))
        if not len(side):
            # At a very low SNR the sites may lose every vehicle.
            counts[measure.name], windows[measure.name] = {}, 0
            continue
        began_s = time.perf_counter()
        predictions = predictions_of(run, side, measure)
        took_s = time.perf_counter() - began_s
        counts[measure.name] = counts_by_group(predictions, len(run.card.classes))
        windows[measure.name] = len(predictions.label)
        if number == 0:
            window_ms = 1e3 * took_s / max(1, len(predictions.label))
            if task.unknown:
                validation = records.take(np.isin(records.groups, task.sides["validation"]))
                unknown = unknown_scores(run, predictions, predictions_of(run, validation, measure))
    return Scores(
        name=task.name,
        training_seed=task.training.seed,
        counts=counts,
        windows=windows,
        parameters=run.card.parameters,
        best_epoch=run.card.best_epoch,
        cpu_s=round(cpu_s, 1),
        window_ms=window_ms,
        unknown=unknown,
        history=_history(task.run) if task.history else None,
    )


def predictions_of(run: Run, records: Records, measure: Measure) -> Predictions:
    """Return a run's predictions on one window of each record, where a measure says that they end."""
    windows = run.card.settings.windows
    if measure.end_after_s is not None:
        moved: dict[str, Any] = {"relative_to": measure.relative_to, "end_after_s": measure.end_after_s}
        windows = WindowSettings.model_validate({**windows.model_dump(), **moved})
    return predict(run, records, draw_ends(records, windows, "evaluate", EVALUATION_SEED))


def counts_by_group(predictions: Predictions, n_classes: int) -> dict[str, Counts]:
    """Return the confusion matrix of the known intentions for each test seed."""
    counts = {}
    for group in np.unique(predictions.group.astype(str)):
        rows = predictions.known & (predictions.group == group)
        counts[str(group)] = confusion(predictions.label[rows], predictions.predicted[rows], n_classes).tolist()
    return counts


def of_measure(scores: Sequence[Scores], measure: str) -> list[dict[str, Counts]]:
    """Return the confusion matrices of one measure, for every training."""
    return [training.counts[measure] for training in scores if measure in training.counts]


def _history(run: Path) -> list[dict[str, float]] | None:
    """Return the scores by epoch of a network's run, None for other predictors."""
    file = run / HISTORY_FILE
    if not file.is_file():
        return None
    table: pd.DataFrame = pd.read_csv(file)
    columns: dict[str, Array] = {str(name): table[name].to_numpy(dtype=np.float64) for name in table.columns}
    return [{name: float(values[k]) for name, values in columns.items()} for k in range(len(table))]
