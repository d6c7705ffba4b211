"""The tasks of a sweep: they can be sent to workers, use their threads, and report what went wrong."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.errors import InputError, OutputError, ShortageError
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.attempts import Item, Outcome, Result
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.studies import cell_tasks, sweep
from isac_cosim.studies.cell_tasks import attempt, run_tasks
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep_results import SweepResult
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

OPTIMISER = {"epochs": 2, "batch": 32, "threads": 2}
FEW_ROUNDS = {"rounds": 4, "ends_per_record": 1}


def study_of(model: str) -> Study:
    training = {**SMALL_RUN.model_dump(), "optimiser": OPTIMISER, "trees": FEW_ROUNDS, "pre_onset": FEW_ROUNDS}
    axes = {"scenarios": ["north"], "models": [model], "training_seeds": [1, 2]}
    content = {"name": "small", "training": training, "evaluation": {"ends_per_record": 2}, "sweep": axes}
    return checked(Study, content, "test")


class PicklingEngine(InlineEngine):
    """Sends tasks and results through pickle, as to worker processes, and notes the threads of each run."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, int]] = []

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        for item in items:
            self.sent.append((type(item).__name__, threads))
            sent_task, sent_item = pickle.loads(pickle.dumps((task, item)))
            yield Outcome(item, result=pickle.loads(pickle.dumps(sent_task(sent_item))))


def swept(model: str, out: Path, engine: Engine, patch: pytest.MonkeyPatch) -> SweepResult:
    def generate(_: object, folder: Path, *__: object) -> object:
        return write_dataset(folder, "north", seeds=6)

    patch.setattr(sweep, "generate", generate)
    return sweep.run_sweep(study_of(model), out, engine)


def files_of(out: Path) -> dict[str, bytes]:
    files = [path for path in sorted(out.rglob("*")) if path.is_file() and path.suffix not in (".ckpt", ".png")]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def test_trainings_and_evaluations_are_tasks_with_their_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell_tasks, "draw_figures", lambda *_: None)
    engine = PicklingEngine()
    result = swept("trees", tmp_path, engine, monkeypatch)
    assert engine.sent == [("CellTraining", 2)] * 2 + [("CellEvaluation", 1)]
    assert [(row.model, row.trainings) for row in result.cells] == [("trees", 2)]


@pytest.mark.slow
def test_worker_processes_leave_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One and four of them: with two threads each, one training runs at a time, or two do."""
    results = [swept("asi-bip", tmp_path / str(workers), LocalEngine(workers), monkeypatch) for workers in (1, 4)]
    assert results[0] == results[1]
    one, four = files_of(tmp_path / "1"), files_of(tmp_path / "4")
    assert list(one) == list(four)
    assert [name for name in one if one[name] != four[name]] == []


class Task:
    """A task that ends as it is told."""

    def __init__(self, error: BaseException | None) -> None:
        self.error = error

    def work(self) -> None:
        if self.error is not None:
            raise self.error


def test_what_goes_wrong_in_a_worker_comes_back_in_one_line() -> None:
    attempt(Task(None))
    for error, line in (
        (ValueError("no\nnumber"), "ValueError: no number"),
        (InputError("too few seeds"), "too few seeds"),
        (FileNotFoundError(2, "No such file"), "FileNotFoundError: [Errno 2] No such file"),
    ):
        outcome = next(InlineEngine().run(attempt, [Task(error)]))
        assert outcome.error == line


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (OutputError("full"), OutputError),
        (OSError(28, "No space left on device"), OutputError),
        (MemoryError(), ShortageError),
        (OSError(24, "Too many open files"), ShortageError),
    ],
)
def test_what_no_other_cell_would_survive_ends_the_sweep(error: Exception, kind: type[Exception]) -> None:
    with pytest.raises(kind):
        next(InlineEngine().run(attempt, [Task(error)]))


class Dying(InlineEngine):
    """An engine whose worker dies in every second task."""

    def run(self, task: Any, items: Iterable[Any], threads: int = 1) -> Generator[Outcome[Any, Any]]:
        for k, item in enumerate(items):
            yield Outcome(item, error="the worker process died") if k % 2 else next(super().run(task, [item]))


def test_a_worker_that_died_is_reported_and_the_others_go_on() -> None:
    feedback, tasks = RecordedFeedback(), [Task(None), Task(None), Task(ValueError("broke"))]
    failed: list[tuple[Task, str]] = []
    run_tasks(tasks, Dying(), feedback, "training", "trainings", lambda task, reason: failed.append((task, reason)))
    assert failed == [(tasks[1], "the worker process died"), (tasks[2], "ValueError: broke")]
    assert feedback.moves == [(0, 3), (1, 3), (2, 3), (3, 3)]
