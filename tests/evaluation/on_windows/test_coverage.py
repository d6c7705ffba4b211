"""What scores lack is said before a training, and it is what the evaluation then finds."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from isac_cosim.evaluation.on_windows import coverage
from isac_cosim.evaluation.on_windows.coverage import lacking, records_without_states
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.report import show
from isac_cosim.evaluation.report.score_table import headline
from isac_cosim.evaluation.report.verdict import verdict
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.split import split
from isac_cosim.models.data.windows import Records
from isac_cosim.models.training.training import train
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset

TREES = SMALL_RUN.model_copy(update={"model": "trees"})


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_dataset(tmp_path_factory.mktemp("made_up") / "data", seeds=4, per_class=4)


def test_records_without_states_are_split_as_the_others(dataset: Dataset) -> None:
    whole, bare = Records.of(dataset), records_without_states(dataset)
    assert bare.tv.shape == whole.tv.shape
    assert split(bare, TREES.split) == split(whole, TREES.split)


def test_what_is_said_before_is_what_is_measured_after(dataset: Dataset, tmp_path: Path) -> None:
    """Few windows of each intention: some have enough before the commit, others not."""
    settings = EvaluateSettings(ends_per_record=4)
    (line,) = lacking(dataset, TREES, settings)
    result = evaluate(train(dataset, tmp_path / "run", TREES), dataset, tmp_path / "report", settings).result
    early = result.before_commit
    assert early is not None
    assert 0 < len(early.macro_f1_over) < len(KNOWN)
    left_out = ", ".join(
        f"{name.replace('_', ' ')} {early.per_class[name].n}"
        for name in result.classes
        if name not in early.macro_f1_over
    )
    over = f"over {len(early.macro_f1_over)} of 6 intentions"
    assert line == (
        f"fewer than 5 test windows end before the commit of {left_out}: "
        f"macro-F1 before the commit is {over}; generate more seeds"
    )
    assert any(over in name for _, name in headline(result))
    assert not any("over" in name for _, name in headline(result) if "all windows" in name)


def test_sides_without_an_intention_are_named(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    records = records_without_states(dataset)
    sides = split(records, TREES.split)
    of_side = np.isin(records.groups, [*sides["validation"], *sides["test"]])
    kept = records.take(~(of_side & np.isin(records.label, [Intention.OVERTAKE, Intention.HARD_BRAKE])))
    monkeypatch.setattr(coverage, "records_without_states", lambda _: kept)
    lines = lacking(dataset, TREES, EvaluateSettings(), sides)
    for side, line in zip(("validation", "test"), lines, strict=False):
        assert line == (
            f"the {side} seeds hold no hard brake, overtake: "
            "every macro-F1 on them is over 4 of 6 intentions; generate more seeds"
        )


def test_a_held_out_intention_is_not_missed(dataset: Dataset) -> None:
    settings = EvaluateSettings(ends_per_record=40)
    assert lacking(dataset, TREES, settings) == []
    without = TREES.model_copy(update={"held_out": "overtake"})
    assert lacking(dataset, without, settings) == []


def test_a_mean_over_fewer_intentions_says_so_wherever_it_stands(dataset: Dataset, tmp_path: Path) -> None:
    """Without an intention in training, every mean is over the other five."""
    without = TREES.model_copy(update={"held_out": "overtake"})
    run = train(dataset, tmp_path / "run", without)
    floor = train(dataset, tmp_path / "floor", without.model_copy(update={"seed": 1}))
    result = evaluate(run, dataset, tmp_path / "out", EvaluateSettings(ends_per_record=40), [floor]).result
    assert result.macro_f1_over == [name for name in result.classes if name != "overtake"]
    console = Console(file=io.StringIO(), width=200)
    show(result, tmp_path, console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    labels = [line for line in printed.splitlines() if line.startswith("│   macro-F1")]
    assert len(labels) == 4
    assert all("over 5 of 6 intentions" in text or "of five" in text for text in labels)
    assert all("over 5 of 6 intentions" in name for _, name in headline(result) if "macro-F1" in name)
    assert all("over 5 of 6 intentions" in line for line in verdict(result) if "macro-F1" in line)
