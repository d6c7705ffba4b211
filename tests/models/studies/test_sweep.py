"""Sweeps: their cells, their table against the evaluations it is made of, resumption, and cells that fail."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

import cosim
from command_line.output import show_sweep
from isacsim.errors import InputError, OutputError, RunError
from isacsim.settings import checked
from labeling.dataset.dataset import Dataset
from labeling.generation.resense import ResenseSettings, resense
from labeling.generation.settings import DatasetStudy
from models.evaluation.evaluation import EvaluateSettings
from models.studies import sweep, sweep_table
from models.studies.study import Study
from models.training.progress import Steps
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

TINY = {
    **SMALL_RUN.model_dump(),
    "optimiser": {"epochs": 1, "batch": 32, "threads": 1},
    "trees": {"rounds": 4, "ends_per_record": 1},
}
EVALUATION = EvaluateSettings(ends_per_record=1).model_dump()
SEEDS = {"north": 6, "south": 4}


def study_of(**axes: object) -> Study:
    return checked(Study, {"name": "small", "training": TINY, "evaluation": EVALUATION, "sweep": axes}, "test")


class Makers:
    """Makes datasets of made-up records, and keeps what was asked for; broken: networks that give no samples."""

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


def run(study: Study, out: Path, makers: Makers) -> tuple[dict[str, Any], str]:
    """What the sweep's table holds, and the messages meanwhile."""
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
        patch.setattr("models.evaluation.evaluation._draw", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory, no_figures: None) -> tuple[dict[str, Any], Path, Makers, str]:
    """One network, two ways of sensing, a network and its floor, two training seeds."""
    makers, out = Makers(), tmp_path_factory.mktemp("sweep") / "out"
    found, said = run(TWO_WAYS, out, makers)
    return found, out, makers, said


def contents(out: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


def test_the_table_has_the_mean_and_spread_of_the_evaluations(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    found, out, _, _ = swept
    assert [(row["sensor"], row["model"], row["trainings"]) for row in found["cells"]] == [
        ("isac", "trees", 2), ("isac", "asi-bip", 2), ("truth", "trees", 2), ("truth", "asi-bip", 2),
    ]  # fmt: skip
    for row in found["cells"]:
        metrics = json.loads((out / row["report"] / "metrics.json").read_text())
        assert row["report"] == f"cells/north/{row['sensor']}/{row['model']}/report"
        floors = [] if row["model"] == "trees" else ["trees", "trees"]
        runs = [(each["settings"]["model"], each["settings"]["seed"]) for each in metrics["made_by"]["runs"]]
        assert runs == list(zip([row["model"]] * 2 + floors, [3, 4] * 2, strict=False))
        everyone = [metrics, *metrics["compared"]]
        for name in ("macro_f1", "accuracy", "auroc_unknown"):
            a, b = (each[name] for each in everyone[:2])
            assert row[name] == pytest.approx((a + b) / 2)
            assert row[f"{name}_sd"] == pytest.approx(abs(a - b) / np.sqrt(2))
        if floors:
            of_trees = np.mean([each["macro_f1"] for each in everyone[2:]])
            assert row["ahead_of_floor"] == pytest.approx(row["macro_f1"] - of_trees)
            assert row["low"] <= row["ahead_of_floor"] <= row["high"]
        else:
            assert row["ahead_of_floor"] is None
    assert json.loads((out / "table.json").read_text()) == json.loads(json.dumps(found))
    table = pd.read_csv(out / "table.csv")
    assert table["macro_f1"].tolist() == pytest.approx([row["macro_f1"] for row in found["cells"]])


def test_cells_of_a_network_share_its_records_and_its_seeds(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    found, out, makers, _ = swept
    assert makers.generated == [("north", out / "datasets" / "north" / "isac")]
    assert makers.sensed == [("truth", out / "datasets" / "north" / "truth")]
    sides = found["made_by"]["seeds"]["north"]
    for card in out.glob("cells/**/run.json"):
        assert json.loads(card.read_text())["split"] == sides
    for metrics in out.glob("cells/**/metrics.json"):
        assert json.loads(metrics.read_text())["made_by"]["seeds"] == sides["test"]


def test_a_sweep_tells_where_it_is_and_ends_in_a_page(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    found, out, _, said = swept
    assert "dataset of north, truth; about " in said
    assert "cell 4 of 4 (north, truth, asi-bip), training seed 4; about " in said
    page = (out / "report" / "index.html").read_text()
    assert page.count("<tr>") == 5
    assert 'href="../cells/north/truth/asi-bip/report/index.html"' in page
    assert (out / "cells/north/truth/asi-bip/report/index.html").is_file()
    assert "data:image/png" in page
    drawn = io.StringIO()
    show_sweep(found, out, Console(file=drawn, width=40))
    (line,) = (line for line in drawn.getvalue().splitlines() if "truth" in line and "asi-bip" in line)
    row = found["cells"][3]
    assert line.split() == [
        "north", "truth", "asi-bip",
        f"{row['macro_f1']:.3f}", f"±{row['macro_f1_sd']:.3f}", f"{row['accuracy']:.3f}", f"±{row['accuracy_sd']:.3f}",
        f"{row['ahead_of_floor']:+.3f}", f"({row['low']:+.3f}", "to", f"{row['high']:+.3f})",
    ]  # fmt: skip


def test_one_test_seed_gives_no_interval(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    found, out, _, _ = swept
    metrics = json.loads((out / found["cells"][3]["report"] / "metrics.json").read_text())
    metrics["over_training_seeds"][-1]["paired_difference"]["groups"] = 1
    row = sweep_table.row_of(TWO_WAYS.cells[3], "north", metrics, "report")
    assert row["ahead_of_floor"] == found["cells"][3]["ahead_of_floor"]
    assert row["low"] is row["high"] is None


def test_a_finished_sweep_answers_again_and_does_nothing(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    found, out, _, _ = swept
    before = contents(out)
    again, said = run(TWO_WAYS, out, Makers())
    assert again == found
    after = contents(out)
    kept = [path for path in before if "cells" in path.parts or "shards" in path.parts]
    assert len(kept) > 40
    assert [before[path] for path in kept] == [after[path] for path in kept]
    assert said == ""


def test_a_sweep_goes_on_where_it_was_interrupted(
    swept: tuple[dict[str, Any], Path, Makers, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped within the second training of a cell, it does that and what follows, and finds the same."""
    found, _, _, _ = swept
    train, calls = sweep.train_records, []

    def counted(*arguments: Any) -> Any:
        calls.append(arguments[2])
        if len(calls) == 4:
            raise KeyboardInterrupt
        return train(*arguments)

    monkeypatch.setattr(sweep, "train_records", counted)
    with pytest.raises(KeyboardInterrupt):
        run(TWO_WAYS, tmp_path / "out", Makers())
    standing = contents(tmp_path / "out" / "cells")
    again, _ = run(TWO_WAYS, tmp_path / "out", Makers())
    assert again == found
    # The floor's cell is passed over; the training that stands of the cell that was stopped in is read again.
    assert len(calls) == 4 + 6
    assert {path: contents(tmp_path / "out")[path] for path in standing} == standing


def test_what_fails_is_told_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A network without samples, and a training that breaks; what else there is stands in the table."""
    train = sweep.train_records

    def fragile(records: Any, made_of: Any, out: Path, settings: Any, *others: Any) -> Any:
        if "truth" in out.parts and settings.seed == 1:
            raise ValueError("the loss\nis no number")
        return train(records, made_of, out, settings, *others)

    monkeypatch.setattr(sweep, "train_records", fragile)
    axes = {"sensors": ["isac", "truth"], "models": ["trees"], "training_seeds": [0, 1]}
    study = study_of(scenarios=["north", "south"], **axes)
    found, said = run(study, tmp_path / "out", Makers("south"))
    assert [(row["network"], row["sensor"], row["trainings"]) for row in found["cells"]] == [
        ("north", "isac", 2), ("north", "truth", 1),
    ]  # fmt: skip
    assert found["cells"][1]["macro_f1_sd"] is None
    assert len(found["failed"]) == 5
    assert found["trainings"] == 8
    assert "left out: south: all 5 episodes failed, the first with: no lane" in said
    assert "left out: north, truth, trees, training seed 1: ValueError: the loss is no number" in said
    page = (tmp_path / "out" / "report" / "index.html").read_text()
    assert page.count("<li>") == 5
    monkeypatch.undo()
    mended, _ = run(study, tmp_path / "out", Makers())
    assert mended["failed"] == []
    assert [row["trainings"] for row in mended["cells"]] == [2, 2, 2, 2]


@pytest.mark.parametrize("error", [OutputError("full"), OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_what_no_other_cell_would_survive_ends_the_sweep(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise error

    monkeypatch.setattr(sweep, "train_records", full)
    with pytest.raises(type(error)):
        run(study_of(scenarios=["north"]), tmp_path / "out", Makers())


def test_predictors_of_one_network_are_tested_on_another(tmp_path: Path) -> None:
    """On that network's own test seeds, beside its own predictors."""
    study = study_of(scenarios=["north", "south"], models=["trees"], test_on=["south"])
    found, _ = run(study, tmp_path, Makers())
    assert [(row["network"], row["tested_on"]) for row in found["cells"]] == [
        ("north", "north"), ("north", "south"), ("south", "south"),
    ]  # fmt: skip
    crossed, own = (tmp_path / row["report"] for row in found["cells"][1:])
    seeds = [json.loads((each / "metrics.json").read_text())["made_by"]["seeds"] for each in (crossed, own)]
    assert seeds[0] == seeds[1] == found["made_by"]["seeds"]["south"]["test"]
    assert "<th>tested on</th>" in (tmp_path / "report" / "index.html").read_text()


def test_the_folder_of_another_sweep_is_refused(swept: tuple[dict[str, Any], Path, Makers, str]) -> None:
    with pytest.raises(InputError, match="another study"):
        run(study_of(scenarios=["north"]), swept[1], Makers())


def test_the_time_left_follows_what_steps_took(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that take twice as long as expected, and one that was done before, of which nothing is told."""
    clock = [0.0]
    monkeypatch.setattr("models.training.progress.time.monotonic", lambda: clock[0])
    feedback = RecordedFeedback()
    steps = Steps(feedback, 3000.0)
    for k, standing in enumerate((False, True, False, False)):
        with steps.step(f"step {k}", 600.0, standing):
            clock[0] += 0.0 if standing else 1200.0
    steps.skip(300.0)
    with steps.step("last", 300.0, False):
        pass
    told = feedback.messages
    assert told[0] == "step 0; about 50 min left"
    assert told[1] == f"step 2; about {1800 * 1260 / 660 / 60:.0f} min left"
    assert told[2] == f"step 3; about {1200 * 2460 / 1260 / 60:.0f} min left"
    assert told[3] == f"last; about {300 * 3660 / 1860 / 60:.0f} min left"


TOML = """
[training]
windows = { window_s = 1.2 }
trees = { rounds = 4, ends_per_record = 1 }
preludes = { use = false }

[evaluation]
ends_per_record = 1

[sweep]
scenarios = ["motorway", "ramp_weave"]
sensors = ["isac", "truth"]
models = ["trees"]
training_seeds = [0, 1]
"""


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the study, where made-up records stand for SUMO's and one network has no samples."""

    def generate(study: DatasetStudy, out: Path, *_: Any, **__: Any) -> Dataset:
        if study.scenarios == ("ramp_weave",):
            raise RunError("all 20 episodes failed, the first with: no lane")
        return Dataset.open(out) if out.exists() else write_dataset(out, *study.scenarios)

    monkeypatch.setattr(sweep, "generate", generate)
    monkeypatch.setattr("labeling.generation.engine.LocalEngine", lambda jobs: InlineEngine())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "both.toml").write_text(TOML)
    return tmp_path


def test_the_command_shows_the_table_and_ends_with_what_failed(
    command: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cosim.main(["run", "both.toml", "--json"]) == 1
    said = capfd.readouterr()
    found = json.loads(said.out)
    assert [(row["network"], row["sensor"], row["trainings"]) for row in found["cells"]] == [
        ("motorway", "isac", 2), ("motorway", "truth", 2),
    ]  # fmt: skip
    assert (found["trainings"], len(found["failed"])) == (8, 4)
    assert f"{found['cells'][0]['macro_f1']:.3f} ±" in said.err
    assert said.err.splitlines()[-1] == (
        "cosim: 4 of 8 trainings failed and are left out, the first of ramp_weave, isac, trees, training seed 0: "
        "all 20 episodes failed, the first with: no lane; the same command tries them again"
    )
    assert (command / found["report"] / "index.html").is_file()
    assert (command / found["table"]).is_file()


def test_a_dry_run_of_a_sweep_writes_nothing(command: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["run", "both.toml", "--dry-run", "--json"]) == 0
    said = capfd.readouterr()
    found = json.loads(said.out)
    assert (found["cells"], found["trainings"], found["datasets"], found["episodes"]) == (4, 8, 4, 40)
    assert "4 cells, 8 trainings, 4 datasets: about 40 episodes" in said.err
    assert [path.name for path in command.iterdir()] == ["both.toml"]


def test_a_network_that_is_not_there_is_told_before_anything_is_made(
    command: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (command / "none.toml").write_text(TOML.replace("ramp_weave", "nowhere"))
    (command / "plain.toml").write_text('dataset.scenarios = ["motorway", "nowhere"]')
    (command / "twice.toml").write_text('dataset.scenarios = ["motorway", "motorway"]')
    (command / "null.toml").write_text('dataset.scenarios = ["\\u0000"]')
    (command / "nameless.toml").write_text('dataset.scenarios = [""]')
    for study, says in (
        ("none.toml", "there is no scenario nowhere"),
        ("plain.toml", "there is no scenario nowhere"),
        ("twice.toml", "motorway is named twice"),
        ("null.toml", "there is no scenario "),
        ("nameless.toml", f"{command} holds 0 SUMO configurations"),
    ):
        for options in ([], ["--dry-run"]):
            assert cosim.main(["run", study, *options]) == 2
            assert capfd.readouterr().err.startswith(f"cosim: {says}")
    assert not (command / "results").exists()
