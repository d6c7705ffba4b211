"""Trainings of a stage leave a file each, and are not run again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import SILENT
from isac_cosim.studies.reproduction.experiments.trainings import Scores, of_measure, run_tasks
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine


@dataclass(frozen=True)
class Training:
    name: str
    scores_file: Path


def scores(task: Training) -> Scores:
    if task.name == "broken":
        raise RuntimeError("out of numbers")
    return Scores(name=task.name, training_seed=0, counts={"test": {"road-1": [[1]]}}, windows={"test": 1})


def trainings(folder: Path, *names: str) -> list[Training]:
    return [Training(name, folder / "scores" / f"{name}.json") for name in names]


def test_what_is_finished_is_read_and_not_run(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="broken: RuntimeError: out of numbers"):
        run_tasks(scores, trainings(tmp_path, "a", "broken", "b"), InlineEngine(), SILENT, "table")
    feedback, ran = RecordedFeedback(), list[str]()

    def noted(task: Training) -> Scores:
        ran.append(task.name)
        return scores(task)

    results = run_tasks(noted, trainings(tmp_path, "b", "a"), InlineEngine(), feedback, "table")
    assert ran == ["b"]
    assert [result.name for result in results] == ["b", "a"]
    assert feedback.moves == [(1, 2), (2, 2)]
    assert run_tasks(noted, trainings(tmp_path, "b", "a"), InlineEngine(), feedback, "table") == results
    assert ran == ["b"]


def test_measures_are_read_by_name() -> None:
    first = Scores(name="a", training_seed=0, counts={"0": {"road-1": [[1]]}, "1": {"road-1": [[2]]}}, windows={})
    second = Scores(name="b", training_seed=1, counts={"0": {"road-2": [[3]]}}, windows={})
    assert of_measure([first, second], "0") == [{"road-1": [[1]]}, {"road-2": [[3]]}]
    assert of_measure([first, second], "1") == [{"road-1": [[2]]}]
