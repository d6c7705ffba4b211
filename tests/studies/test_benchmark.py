"""The frozen test set: a predictor is scored on it, and nothing else is taken for it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.radio import blockage
from isac_cosim.isacsim.traffic import sources
from isac_cosim.labeling.streams import cost_estimate
from isac_cosim.models.data import windows
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies import benchmark
from isac_cosim.studies.benchmark import (
    BenchmarkRow,
    BenchmarkStudy,
    Frozen,
    check,
    freeze,
    read_test_set,
    score,
    table,
)

TREES = TrainSettings.model_validate({"model": "trees", "trees": {"rounds": 10, "ends_per_record": 1}})
TINY = BenchmarkStudy.model_validate(
    {
        "name": "tiny-1",
        "dataset": {
            "scenarios": ["straight_road"],
            "source": "kinematic",
            "seeds": {"first": 1, "last": 3},
            "kinematics": {"per_class": 1, "following_scenes": 1},
        },
        "split": {"validation": 0.34, "test": 0.01},
        "test": {"first": 11, "last": 12},
        "evaluation": {"end_after_s": [0.0, 2.2]},
        "live": {
            "seeds": {"first": 1001, "last": 1001},
            "development": {"first": 2001, "last": 2001},
            "duration_s": 20,
        },
    }
)


@pytest.fixture(scope="module")
def frozen(tmp_path_factory: pytest.TempPathFactory) -> Frozen:
    return freeze(TINY, None, tmp_path_factory.mktemp("frozen") / "benchmark.json")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory, frozen: Frozen) -> Path:
    folder = tmp_path_factory.mktemp("benchmark")
    score(TINY, frozen, TREES, folder, LocalEngine(1), live=False)
    return folder


def row_of(out: Path) -> BenchmarkRow:
    return BenchmarkRow.model_validate_json((out / "trees-0" / "row.json").read_text())


@pytest.mark.slow
def test_a_predictor_is_scored_on_seeds_that_it_was_not_trained_on(out: Path, frozen: Frozen) -> None:
    row = row_of(out)
    assert row.predictor == "boosted trees"
    assert (row.test_set, row.digests) == ("tiny-1", frozen.digests)
    assert list(row.f1_by_lead) == ["0.25", "0.5", "1", "1.5", "2"]
    assert row.windows > 0
    assert row.training_hours is not None
    assert row.training_hours > 0
    measured = json.loads((out / "trees-0" / "test" / "metrics.json").read_text())["made_by"]
    assert measured["seeds"] == ["straight_road-11", "straight_road-12"]
    (taught,) = (run["split"] for run in measured["runs"])
    assert set(taught["train"] + taught["validation"]).isdisjoint(measured["seeds"])
    assert len(taught["test"]) == 1


@pytest.mark.slow
def test_the_same_command_again_scores_the_same(out: Path, frozen: Frozen) -> None:
    before = row_of(out)
    again = score(TINY, frozen, TREES, out, LocalEngine(1), live=False)
    assert again == before


@pytest.mark.slow
def test_samples_of_other_bytes_are_told(out: Path, tmp_path: Path) -> None:
    same = freeze(TINY, out, tmp_path / "same.json")
    assert same.samples
    other = same.model_copy(update={"samples": "0" * 64})
    rows = [score(TINY, of, TREES, out, LocalEngine(1), live=False) for of in (same, other)]
    assert [row.as_frozen for row in rows] == [True, False]
    assert "other bytes" in table([rows[1]], same)
    assert "other bytes" not in table([rows[0]], same)


def test_other_settings_are_refused_by_the_name_of_their_part(frozen: Frozen, monkeypatch: pytest.MonkeyPatch) -> None:
    check(TINY, frozen)
    monkeypatch.setattr(blockage, "CAR_HEIGHT_M", 1.7)
    with pytest.raises(InputError, match="test set tiny-1: sensing changed since it was frozen"):
        check(TINY, frozen)
    monkeypatch.undo()
    seeds = TINY.model_copy(update={"test": TINY.dataset.seeds})
    with pytest.raises(InputError, match="traffic changed"):
        check(seeds, frozen)


def test_settings_of_predictors_are_free(frozen: Frozen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "START_SHARE", 0.9)
    check(TINY, frozen)


def test_what_it_costs_is_no_setting(frozen: Frozen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost_estimate, "SENSED_S", 1.0)
    check(TINY, frozen)


@pytest.mark.slow
def test_a_module_that_a_checkout_gets_meanwhile_is_no_setting(
    frozen: Frozen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a commit lands beside a running study, which goes on with the code that it has loaded."""
    (tmp_path / "landed_meanwhile.py").write_text("DISTANCE_M = 5.0\n")
    monkeypatch.setattr(sources, "__path__", [*sources.__path__, str(tmp_path)])
    check(TINY, frozen)


@pytest.mark.slow
def test_a_training_of_a_study_has_its_own_row(
    out: Path, frozen: Frozen, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(benchmark, "read_test_set", lambda: TINY)
    monkeypatch.setattr(benchmark, "read_frozen", lambda: frozen)
    before = (out / "trees-0" / "row.json").read_bytes()
    study = tmp_path / "early.toml"
    study.write_text("[training.windows]\nend_after_s = [0.0, 2.2]\n[training.trees]\nrounds = 3\n")
    assert benchmark.main([str(out), "--model", "trees", "--study", str(study), "--no-live"]) == 0
    assert "| boosted trees, early |" in capsys.readouterr().out
    row = BenchmarkRow.model_validate_json((out / "trees-early-0" / "row.json").read_text())
    assert row.training is not None
    assert row.training["windows"]["end_after_s"] == [0.0, 2.2]
    assert (out / "trees-0" / "row.json").read_bytes() == before


@pytest.mark.slow
def test_a_table_has_a_row_a_predictor_and_none_of_another_test_set(out: Path, frozen: Frozen) -> None:
    row = row_of(out)
    live = {rate: {"recall": 0.5, "false_alarms_per_vehicle_hour": 1.25} for rate in ("1", "3", "10")}
    better = BenchmarkRow.model_validate(
        row.model_dump() | {"predictor": "ours", "f1_by_lead": dict.fromkeys(row.f1_by_lead, 0.9876), "live": live}
    )
    lines = table([row, better], frozen).splitlines()
    assert lines[0].startswith("| predictor | training, h | F1, 0.25 s |")
    assert lines[0].endswith("| live, 1 | live, 3 | live, 10 | version |")
    assert lines[2].startswith("| ours |")
    assert "| 0.988 |" in lines[2]
    assert "| 0.500 (1.2) |" in lines[2]
    assert lines[3].startswith("| boosted trees |")
    assert "|  |  |  |" in lines[3]
    foreign = row.model_copy(update={"test_set": "other-1"})
    with pytest.raises(InputError, match="boosted trees: was scored on another test set than tiny-1"):
        table([foreign], frozen)


@pytest.mark.slow
def test_live_recall_is_that_of_the_frozen_alarms(out: Path, frozen: Frozen) -> None:
    row = score(TINY, frozen, TREES, out, LocalEngine(1))
    assert row.live is not None
    assert list(row.live) == ["1", "3", "10"]
    prediction = json.loads((out / "trees-0" / "live" / "metrics.json").read_text())["prediction"]
    recalls = {} if prediction is None else {f"{at['chosen_for']:g}": at["recall"] for at in prediction["at"]}
    assert {rate: score.recall for rate, score in row.live.items()} == {rate: recalls.get(rate) for rate in row.live}


def test_the_command_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for arguments, said in (
        ([str(tmp_path), "--model", "treees"], "did you mean trees?"),
        (["--table", str(tmp_path)], "holds no row"),
    ):
        assert benchmark.main(arguments) == 2
        error = capsys.readouterr().err
        assert said in error
        assert len(error.splitlines()) == 1
    monkeypatch.setattr(benchmark, "read_frozen", lambda: Frozen(name="motorway-0", versions={}, digests={}))
    assert benchmark.main([str(tmp_path)]) == 2
    assert "test set motorway-0: traffic, maneuvers" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_bundled_test_set_keeps_its_seeds_apart() -> None:
    test_set = read_test_set()
    seeds = [test_set.dataset.seeds, test_set.test, test_set.live.seeds, test_set.live.development]
    numbers = [number for of in seeds for number in of]
    assert len(numbers) == len(set(numbers))
    assert benchmark.read_frozen().name == test_set.name
