"""Several training seeds of one predictor: grouping, mean and spread, and differences of groups."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sklearn.metrics import f1_score

from models.data.windows import Records, draw_ends
from models.evaluation import repeats
from models.evaluation.evaluation import EvaluateSettings, evaluate_records
from models.evaluation.predictions import answers, unseen
from models.report import figures
from models.report.report import verdict
from models.run import Run
from models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

ONCE = EvaluateSettings(ends_per_record=1)


@pytest.fixture(scope="module")
def again(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "trees", "seed": 1})
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "trees", settings)


@pytest.fixture(scope="module")
def found(
    records: Records, network_run: Run, trees_run: Run, again: Run, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("evaluation") / "out"
    return evaluate_records(trees_run, records, MADE_OF, out, ONCE, [network_run, again])


def test_runs_that_differ_in_the_seed_alone_are_one_predictor(network_run: Run, trees_run: Run, again: Run) -> None:
    assert repeats.same_but_for_seed(trees_run, again)
    assert not repeats.same_but_for_seed(trees_run, network_run)


def test_runs_of_one_model_have_names_of_their_own(found: dict[str, Any]) -> None:
    names = [found["name"], *(each["name"] for each in found["compared"])]
    assert names == ["boosted trees, seed 0", "ASI-BIP", "boosted trees, seed 1"]


def test_mean_and_spread_over_training_seeds(found: dict[str, Any]) -> None:
    trees, network = found["over_training_seeds"]
    assert trees["training_seeds"] == [0, 1]
    assert network["training_seeds"] == [0]
    scores = [found["macro_f1"], found["compared"][1]["macro_f1"]]
    assert trees["macro_f1"] == {
        "mean": pytest.approx(np.mean(scores)), "sd": pytest.approx(abs(scores[0] - scores[1]) / 2**0.5), "n": 2,
    }  # fmt: skip
    assert network["macro_f1"] == {"mean": pytest.approx(found["compared"][0]["macro_f1"]), "sd": None, "n": 1}


def test_the_verdict_tells_groups_with_their_spread(found: dict[str, Any]) -> None:
    trees, network = found["over_training_seeds"]
    line, other = verdict(found)[-2:]
    assert line == (
        f"boosted trees, 2 training seed(s): macro-F1 {trees['macro_f1']['mean']:.3f}, "
        f"standard deviation {trees['macro_f1']['sd']:.3f}."
    )
    assert other.startswith(f"ASI-BIP, 1 training seed(s): macro-F1 {network['macro_f1']['mean']:.3f}; boosted trees")


def test_groups_differ_by_their_mean_scores_on_the_same_windows(
    found: dict[str, Any], records: Records, network_run: Run, trees_run: Run, again: Run
) -> None:
    left = unseen(records, [trees_run])
    ends = draw_ends(left, SMALL_RUN.windows, "evaluate", 0, per_record=1)
    given = [answers(run, left, ends) for run in (trees_run, again, network_run)]
    known = given[0].known
    f1 = [f1_score(each.label[known], each.predicted[known], average="macro") for each in given]
    difference = found["over_training_seeds"][1]["paired_difference"]["macro_f1"]
    assert difference["difference"] == pytest.approx(np.mean(f1[:2]) - f1[2])
    assert difference["low"] <= difference["difference"] <= difference["high"]


def test_nothing_is_summed_up_without_repeats(
    records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    assert "over_training_seeds" not in evaluate_records(
        trees_run, records, MADE_OF, tmp_path / "out", ONCE, [network_run]
    )


def test_figures_show_one_run_of_every_predictor(
    records: Records, network_run: Run, trees_run: Run, again: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[list[str]] = []
    monkeypatch.setattr(figures, "lead_time", lambda rows, _: drawn.append(list(rows)))
    evaluate_records(trees_run, records, MADE_OF, tmp_path / "out", ONCE, [again, network_run])
    assert drawn == [["boosted trees, seed 0", "ASI-BIP"]]
