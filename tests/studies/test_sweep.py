"""Sweeps: their cells, their table against the evaluations behind it, resumption, and cells that fail."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from isac_cosim.base.errors import InputError, OutputError, RunError
from isac_cosim.base.settings import checked
from isac_cosim.command_line.study import show_sweep
from isac_cosim.evaluation.on_windows.results import read_metrics
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.resense import ResenseSettings, resense
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.training.progress import Steps
from isac_cosim.studies import cell_tasks, sweep, sweep_table
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep_results import SweepResult
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

TINY = {
    **SMALL_RUN.model_dump(),
    "optimiser": {"epochs": 1, "batch": 32, "threads": 1},
    "trees": {"rounds": 4, "ends_per_record": 1},
    "pre_onset": {"rounds": 4, "ends_per_record": 1},
}
EVALUATION = EvaluateSettings(ends_per_record=4).model_dump()
SEEDS = {"north": 6, "south": 4}


def study_of(**axes: object) -> Study:
    return checked(Study, {"name": "small", "training": TINY, "evaluation": EVALUATION, "sweep": axes}, "test")


class Makers:
    """Makes datasets of made-up records, and keeps what it made; broken: networks that give no samples."""

    def __init__(self, *broken: str) -> None:
        self.broken, self.generated, self.sensed = broken, [], []

    def generate(self, study: DatasetStudy, folder: Path, *_: object) -> Dataset:
        (network,) = study.scenarios
        if network in self.broken:
            raise RunError("all 5 episodes failed, the first with: no lane")
        self.generated.append((network, folder))
        return Dataset.open(folder) if folder.exists() else write_dataset(folder, network, SEEDS[network])

    def sense(self, dataset: Dataset, settings: ResenseSettings, folder: Path, *_: object) -> Dataset:
        self.sensed.append((settings.sensor, folder))
        return resense(dataset, settings, folder, InlineEngine())


def run(study: Study, out: Path, makers: Makers) -> tuple[SweepResult, str]:
    """The sweep's result, and its messages."""
    feedback = RecordedFeedback()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep, "generate", makers.generate)
        patch.setattr(sweep, "resense", makers.sense)
        table = sweep.run_sweep(study, out, InlineEngine(), feedback)
    return table, "\n".join(feedback.messages)


TWO_WAYS = study_of(scenarios=["north"], sensors=["isac", "truth"], models=["asi-bip"], training_seeds=[3, 4])


@pytest.fixture(scope="module", autouse=True)
def no_figures() -> Iterator[None]:
    """The figures of single evaluations take most of the time, and are tested where they are made."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell_tasks, "draw_figures", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory, no_figures: None) -> tuple[SweepResult, Path, Makers, str]:
    """One network, two ways of sensing, a network and its floor, two training seeds."""
    makers, out = Makers(), tmp_path_factory.mktemp("sweep") / "out"
    result, messages = run(TWO_WAYS, out, makers)
    return result, out, makers, messages


def contents(out: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_the_table_has_the_mean_and_spread_of_the_evaluations(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    result, out, _, _ = swept
    assert [(row.sensor, row.model, row.trainings) for row in result.cells] == [
        ("isac", "trees", 2), ("isac", "asi-bip", 2), ("truth", "trees", 2), ("truth", "asi-bip", 2),
    ]  # fmt: skip
    for row in result.cells:
        metrics = json.loads((out / row.report / "metrics.json").read_text())
        assert row.report == f"cells/north/{row.sensor}/{row.model}/report"
        floors = [] if row.model == "trees" else ["trees", "trees"]
        runs = [(card["settings"]["model"], card["settings"]["seed"]) for card in metrics["made_by"]["runs"]]
        assert runs == list(zip([row.model] * 2 + floors, [3, 4] * 2, strict=False))
        measured = [metrics, *metrics["compared"]]
        assert row.test_seeds == metrics["groups"] == len(metrics["made_by"]["seeds"])
        assert row.before_commit_windows == metrics["before_commit"]["n"]
        for run in measured:
            run["before_commit_macro_f1"] = run["before_commit"]["macro_f1"]
        for name in ("before_commit_macro_f1", "macro_f1", "accuracy", "auroc_unknown"):
            a, b = (run[name] for run in measured[:2])
            assert row.score(name)[0] == pytest.approx((a + b) / 2)
            assert row.score(name)[1] == pytest.approx(abs(a - b) / np.sqrt(2))
        if floors:
            of_trees = np.mean([run["macro_f1"] for run in measured[2:]])
            assert row.ahead_of_floor == pytest.approx(row.macro_f1 - of_trees)
            assert row.low <= row.ahead_of_floor <= row.high
            early_of_trees = np.mean([run["before_commit_macro_f1"] for run in measured[2:]])
            assert row.before_commit_ahead_of_floor == pytest.approx(row.before_commit_macro_f1 - early_of_trees)
            assert row.before_commit_low <= row.before_commit_ahead_of_floor <= row.before_commit_high
        else:
            assert row.ahead_of_floor is None
    assert json.loads((out / "table.json").read_text()) == result.model_dump(mode="json")
    table = pd.read_csv(out / "table.csv")
    assert table["macro_f1"].tolist() == pytest.approx([row.macro_f1 for row in result.cells])


@pytest.mark.slow
def test_cells_of_a_network_share_its_records_and_its_seeds(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    result, out, makers, _ = swept
    assert makers.generated == [("north", out / "datasets" / "north" / "isac")]
    assert makers.sensed == [("truth", out / "datasets" / "north" / "truth")]
    sides = result.made_by.seeds["north"]
    for card in out.glob("cells/**/run.json"):
        assert json.loads(card.read_text())["split"] == sides
    for metrics in out.glob("cells/**/metrics.json"):
        assert json.loads(metrics.read_text())["made_by"]["seeds"] == sides["test"]


@pytest.mark.slow
def test_a_sweep_reports_its_progress_and_ends_in_a_page(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    result, out, _, messages = swept
    assert "dataset of north, truth; about " in messages
    assert "training and evaluation of 4 of 4 cells; about " in messages
    page = (out / "report" / "index.html").read_text()
    assert page.count("<tr>") == 5
    assert 'href="../cells/north/truth/asi-bip/report/index.html"' in page
    assert (out / "cells/north/truth/asi-bip/report/index.html").is_file()
    assert "data:image/png" in page
    best = max(result.cells, key=lambda row: row.before_commit_macro_f1)
    assert f"the best: {best.model} on north, sensed by {best.sensor}" in page
    assert f" in episode {result.made_by.seeds['north']['test'][0]}" in page  # In motion.
    assert (
        'href="../../../../../report/index.html">table of the sweep' in (out / best.report / "index.html").read_text()
    )
    drawn = io.StringIO()
    show_sweep(result, out, Console(file=drawn, width=40))
    (line,) = (line for line in drawn.getvalue().splitlines() if "truth" in line and "asi-bip" in line)
    row = result.cells[3]
    assert line.replace("│", "").split() == [
        "north", "truth", "asi-bip",
        f"{row.before_commit_macro_f1:.3f}", f"±{row.before_commit_macro_f1_sd:.3f}",
        f"{row.macro_f1:.3f}", f"±{row.macro_f1_sd:.3f}", f"{row.accuracy:.3f}", f"±{row.accuracy_sd:.3f}",
        f"{row.before_commit_ahead_of_floor:+.3f}",
        f"({row.before_commit_low:+.3f}", "to", f"{row.before_commit_high:+.3f})",
    ]  # fmt: skip


@pytest.mark.slow
def test_one_test_seed_gives_no_interval(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    result, out, _, _ = swept
    evaluation = read_metrics(out / result.cells[3].report)
    assert evaluation is not None
    assert evaluation.over_training_seeds is not None
    trees = evaluation.over_training_seeds[-1]
    assert trees.paired_difference is not None
    names = ("paired_difference", "paired_difference_before_commit")
    single = trees.model_copy(update={name: getattr(trees, name).model_copy(update={"groups": 1}) for name in names})
    evaluation = evaluation.model_copy(update={"over_training_seeds": [*evaluation.over_training_seeds[:-1], single]})
    row = sweep_table.row_of(TWO_WAYS.cells[3], "north", evaluation, "report")
    assert row.ahead_of_floor == result.cells[3].ahead_of_floor
    assert row.low is row.high is row.before_commit_low is row.before_commit_high is None


@pytest.mark.slow
def test_a_finished_sweep_returns_its_result_and_does_nothing(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    result, out, _, _ = swept
    before = contents(out)
    again, messages = run(TWO_WAYS, out, Makers())
    assert again == result
    after = contents(out)
    kept = [path for path in before if "cells" in path.parts or "shards" in path.parts]
    assert len(kept) > 40
    assert [before[path] for path in kept] == [after[path] for path in kept]
    assert messages == ""


@pytest.mark.slow
def test_the_page_of_a_finished_sweep_is_made_anew_without_simulating(
    swept: tuple[SweepResult, Path, Makers, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page of another version of the tool becomes that of this one; what moves on it is kept beside it."""
    result, out, _, _ = swept
    shutil.copytree(out, tmp_path / "out")
    page = tmp_path / "out" / "report" / "index.html"
    now = page.read_text()
    page.write_text(now.replace("<h1>", "<h1>Former "))
    assert page.read_text() != now
    monkeypatch.setattr(sweep, "replay_of_test", lambda *_: pytest.fail("simulated again"))
    again, messages = run(TWO_WAYS, tmp_path / "out", Makers())
    assert again == result
    assert messages == ""
    assert page.read_text() == now


@pytest.mark.slow
def test_a_sweep_written_under_the_former_name_of_a_key_is_finished(
    swept: tuple[SweepResult, Path, Makers, str], tmp_path: Path
) -> None:
    """The window-end curve was called `sweep`, in the study and in each evaluation."""
    result, out, _, _ = swept
    shutil.copytree(out, tmp_path / "out")
    written = [*(tmp_path / "out").rglob("metrics.json"), tmp_path / "out" / "study.json"]
    for path in written:
        content = path.read_text()
        assert content.count('"window_end_curve": null') == 1
        path.write_text(content.replace('"window_end_curve": null', '"sweep": null'))
    again, messages = run(TWO_WAYS, tmp_path / "out", Makers())
    assert again == result
    assert messages == ""


@pytest.mark.slow
def test_a_sweep_goes_on_where_it_was_interrupted(
    swept: tuple[SweepResult, Path, Makers, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted in the second training of a cell, it repeats that, goes on, and finds the same."""
    result, _, _, _ = swept
    train, calls = cell_tasks.train_records, []

    def counted(*arguments: Any, **sides: Any) -> Any:
        calls.append(arguments[2])
        if len(calls) == 4:
            raise KeyboardInterrupt
        return train(*arguments, **sides)

    monkeypatch.setattr(cell_tasks, "train_records", counted)
    with pytest.raises(KeyboardInterrupt):
        run(TWO_WAYS, tmp_path / "out", Makers())
    before = contents(tmp_path / "out" / "cells")
    again, _ = run(TWO_WAYS, tmp_path / "out", Makers())
    assert again == result
    # Finished trainings are passed over.
    assert len(calls) == 4 + 5
    assert {path: contents(tmp_path / "out")[path] for path in before} == before


@pytest.mark.slow
def test_what_fails_is_reported_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A network without samples, and a training that breaks; all else is in the table."""
    train = cell_tasks.train_records

    def fragile(records: Any, made_of: Any, out: Path, settings: Any, **sides: Any) -> Any:
        if "truth" in out.parts and settings.seed == 1:
            raise ValueError("the loss\nis no number")
        return train(records, made_of, out, settings, **sides)

    monkeypatch.setattr(cell_tasks, "train_records", fragile)
    axes = {"sensors": ["isac", "truth"], "models": ["trees"], "training_seeds": [0, 1]}
    study = study_of(scenarios=["north", "south"], **axes)
    result, messages = run(study, tmp_path / "out", Makers("south"))
    assert [(row.network, row.sensor, row.trainings) for row in result.cells] == [
        ("north", "isac", 2), ("north", "truth", 1),
    ]  # fmt: skip
    assert result.cells[1].macro_f1_sd is None
    assert len(result.failed) == 5
    assert result.trainings == 8
    assert "left out: south: all 5 episodes failed, the first with: no lane" in messages
    assert "left out: north, truth, trees, training seed 1: ValueError: the loss is no number" in messages
    page = (tmp_path / "out" / "report" / "index.html").read_text()
    assert page.count("<li>") == 5
    monkeypatch.undo()
    repeated, _ = run(study, tmp_path / "out", Makers())
    assert repeated.failed == []
    assert [row.trainings for row in repeated.cells] == [2, 2, 2, 2]


@pytest.mark.parametrize(
    ("error", "ends_in"),
    [
        (OutputError("full"), OutputError),
        (OSError(28, "No space left on device"), OutputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_what_no_other_cell_would_survive_ends_the_sweep(
    error: BaseException, ends_in: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(cell_tasks, "train_records", full)
    with pytest.raises(ends_in):
        run(study_of(scenarios=["north"]), tmp_path / "out", Makers())


def test_predictors_of_one_network_are_tested_on_another(tmp_path: Path) -> None:
    """On that network's own test seeds, beside its own predictors."""
    study = study_of(scenarios=["north", "south"], models=["trees"], test_on=["south"])
    result, _ = run(study, tmp_path, Makers())
    assert [(row.network, row.tested_on) for row in result.cells] == [
        ("north", "north"), ("north", "south"), ("south", "south"),
    ]  # fmt: skip
    crossed, direct = (tmp_path / row.report for row in result.cells[1:])
    seeds = [json.loads((folder / "metrics.json").read_text())["made_by"]["seeds"] for folder in (crossed, direct)]
    assert seeds[0] == seeds[1] == result.made_by.seeds["south"]["test"]
    assert ">tested on</th>" in (tmp_path / "report" / "index.html").read_text()


@pytest.mark.slow
def test_the_folder_of_another_sweep_is_refused(swept: tuple[SweepResult, Path, Makers, str]) -> None:
    with pytest.raises(InputError, match="another study"):
        run(study_of(scenarios=["north"]), swept[1], Makers())


def test_the_time_left_follows_what_steps_took(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that take twice as long as expected, and one that was done before, which is not reported."""
    clock = [0.0]
    monkeypatch.setattr("isac_cosim.models.training.progress.time.monotonic", lambda: clock[0])
    feedback = RecordedFeedback()
    steps = Steps(feedback, 3000.0)
    for k, finished in enumerate((False, True, False, False)):
        with steps.step(f"step {k}", 600.0, finished):
            clock[0] += 0.0 if finished else 1200.0
    steps.skip(300.0)
    with steps.step("last", 300.0, False):
        pass
    messages = feedback.messages
    assert messages[0] == "step 0; about 50 min left"
    assert messages[1] == f"step 2; about {1800 * 1260 / 660 / 60:.0f} min left"
    assert messages[2] == f"step 3; about {1200 * 2460 / 1260 / 60:.0f} min left"
    assert messages[3] == f"last; about {300 * 3660 / 1860 / 60:.0f} min left"
