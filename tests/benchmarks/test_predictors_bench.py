"""The bench of the predictors, made small: what it compares, and on which windows."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.benchmarks.findings import predictors as bench
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.networks.lightning_module import NetworkModule
from isac_cosim.models.runs.settings import TrainSettings
from tests.support.made_up import SMALL_RUN
from tests.support.made_up_dataset import write_dataset
from tests.support.scripted import InlineEngine

TABLES = Path(__file__).parents[2] / "docs" / "predictor_tables.py"
SMALL = TrainSettings.model_validate(
    {
        **SMALL_RUN.model_dump(mode="json", include={"asi_bip", "trees", "windows"}),
        "pre_onset": {"rounds": 4, "ends_per_record": 1},
        "split": {"validation": 0.2, "test": 0.3},
        "optimiser": {"epochs": 1, "batch": 32, "threads": 1},
    }
)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "TUNED", SMALL)
    monkeypatch.setattr(bench, "PREDICTORS", ("asi-bip", "trees"))
    monkeypatch.setattr(bench, "COMPARED", ("trees",))
    monkeypatch.setattr(bench, "SHARES", (0.5, 1.0))
    monkeypatch.setattr(bench, "draw_figures", lambda *_: None)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_predictors_stand_side_by_side_on_seeds_that_none_was_trained_on(tmp_path: Path) -> None:
    first, second = write_dataset(tmp_path / "own", "north", 8), write_dataset(tmp_path / "other", "south", 3)
    result = bench.run(first, tmp_path / "out", 2, second, engine=InlineEngine())
    assert result == json.loads((tmp_path / "out" / "predictors.json").read_text())
    for ends in ("early", "late"):
        rows = result[ends]["predictors"]
        assert [row["training_seeds"] for row in rows] == [[0, 1]] * 2
        assert "paired_difference" not in rows[0]
        assert all(set(row["paired_difference"]["macro_f1"]) >= {"difference", "low", "high"} for row in rows[1:])
        assert len(result[ends]["runs"]) == 4
    assert [row["name"] for row in result["by_window_end"]] == ["ASI-BIP", "boosted trees"]
    assert all(len({end["end_s"] for end in row["by_window_end"]}) > 3 for row in result["by_window_end"])
    for row in result["longer"].values():
        assert [predictor["name"] for predictor in row["predictors"]] == ["ASI-BIP", "boosted trees"]
    card = json.loads((tmp_path / "out" / "longer" / "asi-bip-1-0" / "run.json").read_text())
    assert card["settings"]["optimiser"]["epochs"] == 3
    half, whole = (next(r for r in result["samples"] if (r["model"], r["share"]) == ("trees", s)) for s in (0.5, 1.0))
    assert half["samples"] == pytest.approx(whole["samples"] / 2)
    assert half["windows"] == whole["windows"]
    for part, places in (("truth", {"sensed", "true"}), ("other", {"own", "other"})):
        assert {row["on"] for row in result[part]} == places
        assert len(result[part]) == 4
    # Every seed of the other road is new to the predictors, and a share of their own road's.
    on_other, on_own = (next(r for r in result["other"] if r["on"] == place) for place in ("other", "own"))
    assert on_other["windows"] == 3 * on_own["windows"] / round(0.3 * 8)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_stages_run_one_by_one_leave_the_same_file_and_nothing_is_measured_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = write_dataset(tmp_path / "own", "north", 8)
    whole = bench.run(dataset, tmp_path / "whole", 1, engine=InlineEngine())
    for stage in ("samples", "truth", "window_ends", "longer", "windows"):
        bench.run(dataset, tmp_path / "parts", 1, stages=[stage], engine=InlineEngine())
    assert json.loads((tmp_path / "parts" / bench.RESULT_FILE).read_text()) == whole

    def refuse(*_: object) -> None:
        raise AssertionError("measured or trained again")

    monkeypatch.setattr(bench, "evaluate_records", refuse)
    monkeypatch.setattr(bench, "train_records", refuse)
    assert bench.run(dataset, tmp_path / "whole", 1, engine=InlineEngine()) == whole
    assert list(runpy.run_path(str(TABLES))["tables"](whole))
    # Other windows are measured anew.
    monkeypatch.setattr(bench, "ENDS", {"early": (0.0, 0.9), "late": (1.0, 2.2)})
    with pytest.raises(AssertionError, match="again"):
        bench.run(dataset, tmp_path / "whole", 1, engine=InlineEngine())


@pytest.mark.slow
def test_predictors_with_the_same_network_train_it_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_dataset(tmp_path / "own", "north", 8).path
    training = SMALL.model_copy(update={"model": "ensemble"})
    bench.BenchTraining(folder, "tv", training, tmp_path / "alone").work()
    bench.BenchTraining(folder, "tv", training.model_copy(update={"model": "asi-bip"}), tmp_path / "network").work()

    def refuse(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(NetworkModule, "training_step", refuse)
    bench.BenchTraining(folder, "tv", training, tmp_path / "shared", tmp_path / "network").work()
    for name in ("weights.pt", "history.csv", "trees.skops", "reference.npz", "run.json"):
        assert (tmp_path / "shared" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    # The network of another seed is not taken.
    other_seed = training.model_copy(update={"seed": 1})
    with pytest.raises(AssertionError, match="again"):
        bench.BenchTraining(folder, "tv", other_seed, tmp_path / "other", tmp_path / "network").work()


def test_the_stage_other_needs_a_dataset(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "own", "north", 8)
    with pytest.raises(InputError, match="--other"):
        bench.run(dataset, tmp_path / "out", 1, stages=["other"], engine=InlineEngine())


STUDY = """
[dataset]
source = "kinematic"
scenarios = ["straight_road"]
seeds = { first = 1, last = 6 }
[dataset.kinematics]
per_class = 2
following_scenes = 1
"""


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_the_command_makes_its_dataset_and_goes_on_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study, dataset = tmp_path / "study.toml", tmp_path / "dataset"
    study.write_text(STUDY)
    monkeypatch.setattr(bench, "FULL_STUDY", study)
    command = ["predictors", str(dataset), str(tmp_path / "out"), "--seeds", "1", "--stages", "truth"]
    monkeypatch.setattr("sys.argv", command)
    with pytest.raises(InputError, match="dataset"):
        bench.main()
    monkeypatch.setattr("sys.argv", [*command, "--generate"])
    for _ in range(2):
        bench.main()
        result = json.loads(capsys.readouterr().out)
        assert result["dataset"] == Dataset.open(dataset).digest
        assert result["scenario_seeds"] == 6


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_a_folder_of_other_settings_is_refused(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "own", "north", 8)
    bench.run(dataset, tmp_path / "out", 1, stages=["truth"], engine=InlineEngine())
    with pytest.raises(InputError, match="choose a new folder"):
        bench.run(dataset, tmp_path / "out", 2, stages=["truth"], engine=InlineEngine())


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_the_tables_of_the_page_hold_what_was_measured(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "own", "north", 8)
    result = bench.run(dataset, tmp_path / "out", 2, stages=["windows", "truth"], engine=InlineEngine())
    lines = "\n\n".join(runpy.run_path(str(TABLES))["tables"](result)).splitlines()
    trees = [run for run in result["early"]["runs"] if run["model"] == "trees"]
    origin = [run["before_commit"]["by_origin"]["natural"]["macro_f1"] for run in trees]
    row = f"| boosted trees | {np.mean(origin):.3f} ±{np.std(origin, ddof=1):.3f} |"
    assert row in lines[lines.index("### Before the commit, by origin") :]
    lead = trees[0]["before_commit"]["by_lead"][0]
    assert any(line.startswith("| windows |") and f" {lead['n']} |" in line for line in lines)
    true = next(r for r in result["truth"] if (r["model"], r["ends"], r["on"]) == ("trees", "late", "true"))
    after = lines[next(k for k, line in enumerate(lines) if line.startswith("### Sensed against true")) :]
    assert any("| late |" in line and f"{true['macro_f1']['mean']:.3f} ±" in line for line in after)
    assert not any(line.startswith("### Longer training") for line in lines)
