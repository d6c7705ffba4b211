"""Sweeps from the command line: the table, what failed, and networks that do not exist."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import cosim
from isac_cosim.base.errors import RunError
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.studies import cell_tasks, sweep
from tests.support.made_up_dataset import write_dataset
from tests.support.scripted import InlineEngine

TOML = """
[training]
windows = { window_s = 1.2 }
trees = { rounds = 4, ends_per_record = 1 }
pre_onset = { use = false }
optimiser = { threads = 1 }

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
    monkeypatch.setattr(cell_tasks, "draw_figures", lambda *_: None)  # takes most of the time, tested elsewhere
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "both.toml").write_text(TOML)
    return tmp_path


def test_the_command_shows_the_table_and_ends_with_what_failed(
    command: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cosim.main(["run", "both.toml", "--json"]) == 1
    output = capfd.readouterr()
    result = json.loads(output.out)
    assert [(row["network"], row["sensor"], row["trainings"]) for row in result["cells"]] == [
        ("motorway", "isac", 2), ("motorway", "truth", 2),
    ]  # fmt: skip
    assert (result["trainings"], len(result["failed"])) == (8, 4)
    assert f"{result['cells'][0]['macro_f1']:.3f} ±" in output.err
    assert output.err.splitlines()[-1] == (
        "cosim: 4 of 8 trainings failed and are left out, the first of ramp_weave, isac, trees, training seed 0: "
        "all 20 episodes failed, the first with: no lane; the same command tries them again"
    )
    assert (command / result["report"] / "index.html").is_file()
    assert (command / result["table"]).is_file()


def test_a_dry_run_of_a_sweep_writes_nothing(command: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["run", "both.toml", "--dry-run", "--json"]) == 0
    output = capfd.readouterr()
    result = json.loads(output.out)
    assert (result["cells"], result["trainings"], result["datasets"], result["episodes"]) == (4, 8, 4, 40)
    assert "4 cells, 8 trainings, 4 datasets: about 40 episodes" in output.err
    assert [path.name for path in command.iterdir()] == ["both.toml"]


def test_a_network_that_does_not_exist_is_reported_before_anything_is_made(
    command: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (command / "none.toml").write_text(TOML.replace("ramp_weave", "nowhere"))
    (command / "plain.toml").write_text('dataset.scenarios = ["motorway", "nowhere"]')
    (command / "twice.toml").write_text('dataset.scenarios = ["motorway", "motorway"]')
    (command / "null.toml").write_text('dataset.scenarios = ["\\u0000"]')
    (command / "nameless.toml").write_text('dataset.scenarios = [""]')
    for study, message in (
        ("none.toml", "there is no scenario nowhere"),
        ("plain.toml", "there is no scenario nowhere"),
        ("twice.toml", "motorway is named twice"),
        ("null.toml", "there is no scenario "),
        ("nameless.toml", "nameless.toml: dataset.scenarios.0: must have at least 1 character"),
    ):
        for options in ([], ["--dry-run"]):
            assert cosim.main(["run", study, *options]) == 2
            assert capfd.readouterr().err.startswith(f"cosim: {message}")
    assert not (command / "results").exists()
