"""Several training seeds of one predictor: grouping, mean and spread, and differences of groups."""

import json
from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics import f1_score

from isac_cosim.evaluation.on_windows import repeats
from isac_cosim.evaluation.on_windows.evaluation import Evaluation, evaluate_records
from isac_cosim.evaluation.on_windows.predictions import predict, unseen
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report import figures
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.verdict import verdict
from isac_cosim.models.data.windows import Records, draw_ends
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

ONCE = EvaluateSettings(ends_per_record=1)


@pytest.fixture(scope="module")
def again(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "trees", "seed": 1})
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "trees", settings)


@pytest.fixture(scope="module")
def evaluation(
    records: Records, network_run: Run, trees_run: Run, again: Run, tmp_path_factory: pytest.TempPathFactory
) -> Evaluation:
    out = tmp_path_factory.mktemp("evaluation") / "out"
    return evaluate_records(trees_run, records, MADE_OF, out, ONCE, [network_run, again])


@pytest.fixture(scope="module")
def result(evaluation: Evaluation) -> EvaluationResult:
    return evaluation.result


def test_runs_that_differ_in_the_seed_alone_are_one_predictor(network_run: Run, trees_run: Run, again: Run) -> None:
    assert repeats.same_but_for_seed(trees_run, again)
    assert not repeats.same_but_for_seed(trees_run, network_run)


def test_runs_of_one_model_have_names_of_their_own(result: EvaluationResult) -> None:
    names = [run.name for run in result.runs]
    assert names == ["boosted trees, seed 0", "ASI-BIP", "boosted trees, seed 1"]


def test_mean_and_spread_over_training_seeds(result: EvaluationResult) -> None:
    assert result.over_training_seeds is not None
    trees, network = result.over_training_seeds
    assert trees.training_seeds == [0, 1]
    assert network.training_seeds == [0]
    first, second = result.macro_f1, result.compared[1].macro_f1
    assert first is not None
    assert second is not None
    assert trees.macro_f1.mean == pytest.approx(np.mean([first, second]))
    assert trees.macro_f1.sd == pytest.approx(abs(first - second) / 2**0.5)
    assert trees.macro_f1.n == 2
    assert network.macro_f1.mean == pytest.approx(result.compared[0].macro_f1)
    assert (network.macro_f1.sd, network.macro_f1.n) == (None, 1)
    content = result.model_dump(mode="json")["over_training_seeds"]
    for key in ("paired_difference", "paired_difference_before_commit", "paired_difference_by_lead"):
        assert [key in group for group in content] == [False, True]


def test_the_verdict_sums_up_groups_with_their_spread(result: EvaluationResult) -> None:
    assert result.over_training_seeds is not None
    trees, network = result.over_training_seeds
    line, other = verdict(result)[-2:]
    assert line == (
        f"boosted trees, 2 training seed(s): macro-F1 before the commit over 2 of 6 intentions "
        f"{trees.before_commit_macro_f1.mean:.3f}, "
        f"standard deviation {trees.before_commit_macro_f1.sd:.3f}."
    )
    assert other.startswith(
        f"ASI-BIP, 1 training seed(s): macro-F1 before the commit over 2 of 6 intentions "
        f"{network.before_commit_macro_f1.mean:.3f}; "
        "boosted trees minus it"
    )


def test_groups_differ_by_their_mean_scores_on_the_same_windows(
    result: EvaluationResult, records: Records, network_run: Run, trees_run: Run, again: Run
) -> None:
    left = unseen(records, [trees_run])
    ends = draw_ends(left, SMALL_RUN.windows, "evaluate", 0, per_record=1)
    predictions = [predict(run, left, ends) for run in (trees_run, again, network_run)]
    known = predictions[0].known
    f1 = [f1_score(of_run.label[known], of_run.predicted[known], average="macro") for of_run in predictions]
    assert result.over_training_seeds is not None
    paired = result.over_training_seeds[1].paired_difference
    assert paired is not None
    assert paired.macro_f1.difference == pytest.approx(np.mean(f1[:2]) - f1[2])
    assert paired.macro_f1.low <= paired.macro_f1.difference <= paired.macro_f1.high


def test_nothing_is_summed_up_without_repeats(
    records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    evaluate_records(trees_run, records, MADE_OF, tmp_path / "out", ONCE, [network_run])
    assert "over_training_seeds" not in json.loads((tmp_path / "out" / "metrics.json").read_text())


def test_figures_show_one_run_of_every_predictor(
    evaluation: Evaluation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[list[str]] = []
    monkeypatch.setattr(figures, "lead_time", lambda rows, _: drawn.append(list(rows)))
    draw_figures(evaluation, tmp_path)
    assert drawn == [["boosted trees, seed 0", "ASI-BIP"]]


def test_a_run_beside_itself_is_no_repetition(records: Records, trees_run: Run, tmp_path: Path) -> None:
    """As in a study of the floor: a standard deviation of 0 over two training seeds would be none."""
    assert not repeats.same_but_for_seed(trees_run, trees_run)
    evaluate_records(trees_run, records, MADE_OF, tmp_path / "out", ONCE, [trees_run])
    assert "over_training_seeds" not in json.loads((tmp_path / "out" / "metrics.json").read_text())
