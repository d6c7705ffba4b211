"""From a dataset on disk to the report: the functions that the command line calls."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from command_line.progress import ConsoleFeedback
from labeling.dataset.dataset import Dataset
from models.evaluation.evaluation import evaluate
from models.evaluation.settings import EvaluateSettings
from models.report.report import write_report
from models.training.training import train
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import STUDY, write_dataset

TREES = SMALL_RUN.model_copy(update={"model": "trees"})


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_dataset(tmp_path_factory.mktemp("made_up") / "data")


def test_train_evaluate_report(dataset: Dataset, tmp_path: Path) -> None:
    run = train(dataset, tmp_path / "run", TREES)
    assert run.card.dataset == {"digest": dataset.digest, "study": STUDY}
    evaluation = evaluate(run, dataset, tmp_path / "report", EvaluateSettings(ends_per_record=1))
    assert evaluation.result.made_by.dataset.digest == dataset.digest
    page = write_report(evaluation, dataset, tmp_path / "report")
    assert page.name == "index.html"
    assert "this is the one" in page.read_text()
    assert {path.name for path in page.parent.glob("*.png")} == {
        "confusion.png", "lead_time.png", "unknown_roc.png", "unknown_lead_time.png", "record.png",
    }  # fmt: skip


def test_progress_is_drawn_on_a_terminal(dataset: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    short = SMALL_RUN.model_copy(update={"optimiser": SMALL_RUN.optimiser.model_copy(update={"epochs": 1})})
    train(dataset, tmp_path / "run", short, ConsoleFeedback(console))
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    assert "epoch 1/1" in drawn
    assert "left" in drawn
    # Lightning's own remarks stay away.
    assert capfd.readouterr() == ("", "")
