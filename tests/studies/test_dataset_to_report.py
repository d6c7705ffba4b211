"""From a dataset on disk to the report: the functions that the command line calls."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.evaluation.on_windows.passing import PullOuts
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.report import show, write_report
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.models.training.training import train
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
    assert "passing" not in evaluation.result.model_dump()
    assert {path.name for path in page.parent.glob("*.png")} == {
        "confusion.png", "lead_time.png", "unknown_roc.png", "unknown_lead_time.png", "record.png",
    }  # fmt: skip


def test_pull_outs_are_asked_whether_they_pass(tmp_path: Path) -> None:
    passing = write_dataset(tmp_path / "data", seeds=6, per_class=4, passing=True)
    dropped = dropped_pull_outs(passing)
    run = train(passing, tmp_path / "run", TREES)
    assert sum(run.card.counts.values()) == 6 * 4 * len(run.card.split["train"])
    evaluation = evaluate(run, passing, tmp_path / "report", EvaluateSettings(leads_s=()))
    result = evaluation.result
    assert result.passing is not None
    seeds = [int(group.rpartition("-")[2]) for group in result.made_by.seeds]
    for part in result.passing:
        outcomes = dropped.frame(["seed", "pull_out"]).query("seed in @seeds")["pull_out"].value_counts()
        assert 0 < part.pull_outs["passed_did_not_return"] <= outcomes["passed_did_not_return"]
        assert part.groups == len(seeds)
    page = write_report(evaluation, passing, tmp_path / "report").read_text()
    console = Console(file=io.StringIO(), width=200)
    show(result, tmp_path / "report", console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    first = result.passing[0]
    assert first.trained is not None
    for text in (page, printed):
        assert "Does the TV pass the UV within a time of the window" in text
        assert f"{first.answers[0].auroc:.3f}" in text
        assert f"{first.trained.auroc:.3f}" in text
    assert f"<td>{first.trained.brier:.3f} ({first.brier_of_base_rate:.3f})</td>" in page
    assert f"<td>{first.already_passed}, {first.censored}</td>" in page
    assert (tmp_path / "report" / "passing.png").stat().st_size > 5000
    # Without the dropped ones, the others are chosen by what became of them.
    chosen = passing.meta.model_copy(update={"study": {"selection": {"pull_outs": 0}}})
    assert PullOuts.of(passing) is not None
    assert PullOuts.of(replace(passing, meta=chosen)) is None


def test_progress_is_drawn_on_a_terminal(dataset: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    short = SMALL_RUN.model_copy(update={"optimiser": SMALL_RUN.optimiser.model_copy(update={"epochs": 1})})
    train(dataset, tmp_path / "run", short, ConsoleFeedback(console))
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    assert "epoch 1/1" in drawn
    assert "left" in drawn
    # Lightning's own remarks stay away.
    assert capfd.readouterr() == ("", "")
