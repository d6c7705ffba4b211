"""Whether the TV passes the UV soon: the answer of every window, and scores that anybody can recompute."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from scipy.special import expit
from sklearn.calibration import calibration_curve
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import brier_score_loss, roc_auc_score

from isac_cosim.evaluation.on_windows.evaluation import Evaluation, evaluate_records
from isac_cosim.evaluation.on_windows.passing import (
    LEAST_OF_EACH,
    LEAST_SCALE,
    PassWindows,
    PullOuts,
    ask,
    fit_calibration,
    own_answer,
    pass_scores,
)
from isac_cosim.evaluation.on_windows.results import read_metrics
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from tests.support.made_up import MADE_OF
from tests.support.made_up_pull_outs import make_pull_outs
from tests.support.recomputed_metrics import jackknife

SETTINGS = EvaluateSettings(ends_per_record=3, leads_s=(0.5,))


@pytest.fixture(scope="module")
def pull_outs(records: Records) -> PullOuts:
    return make_pull_outs(records)


@pytest.fixture(scope="module")
def written(
    records: Records, pull_outs: PullOuts, network_run: Run, trees_run: Run, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Evaluation, Path]:
    out = tmp_path_factory.mktemp("passing") / "report"
    return evaluate_records(trees_run, records, MADE_OF, out, SETTINGS, [network_run], pull_outs), out


def one_window(t_pass: float, t_pair_end: float, end_s: float) -> PassWindows:
    table = pd.DataFrame({"pull_out": ["unresolved"], "t_pass": [t_pass], "t_pair_end": [t_pair_end]}, index=["a"])
    no_records = Records(np.empty((0, 6, 5), np.float32), np.empty((0, 6, 5), np.float32), 1, 1, pd.DataFrame())
    names = np.array(["a"], dtype=object)
    return PassWindows.of(PullOuts(table, no_records), names, np.array(["toy-1"], dtype=object), np.array([end_s]))


times = st.integers(0, 400).map(lambda k: k / 10)


@settings(max_examples=60, deadline=None)
@given(t_pass=times, later=times, end_s=times, within_s=st.sampled_from([5.0, 10.0]))
def test_a_window_either_side_of_the_passing_gets_the_right_answer(
    t_pass: float, later: float, end_s: float, within_s: float
) -> None:
    """Nothing is asked after the passing, nor where the pair is not observed for the whole time."""
    t_pair_end = t_pass + later
    window = one_window(t_pass, t_pair_end, end_s)
    tenths = [round(10 * time) for time in (t_pass, t_pair_end, end_s, within_s)]
    passed = tenths[0] <= tenths[2]
    seen = tenths[1] >= tenths[2] + tenths[3]
    assert window.already_passed[0] == passed
    assert window.censored(within_s)[0] == (not passed and not seen)
    assert window.asked(within_s)[0] == (not passed and seen)
    if not passed:
        assert window.passes(within_s)[0] == (tenths[0] - tenths[2] <= tenths[3])
        never = one_window(np.nan, t_pair_end, end_s)
        assert not never.passes(within_s)[0]
        # Whether a window counts does not depend on what happens after it.
        assert never.asked(within_s)[0] == window.asked(within_s)[0]


def recomputed(table: pd.DataFrame, within_s: float, column: str) -> dict[str, Any]:
    """What metrics.json says of one answer, from the rows of one run; column: the answer."""
    rows = table[table["windows"].isin(["drawn", "dropped_pull_out"]) & (table["pull_out"] != "")]
    passed = rows["t_pass"] <= rows["end_s"]
    seen = rows["t_pair_end"] >= rows["end_s"] + within_s
    asked = rows[~passed & seen]
    truth = (asked["t_pass"] <= asked["end_s"] + within_s).to_numpy()
    group = asked["scenario"] + "-" + asked["seed"].astype(str)
    answer = asked[column].to_numpy()
    value = roc_auc_score(truth, answer)
    half = jackknife([roc_auc_score(truth[group != name], answer[group != name]) for name in sorted(set(group))])
    return {
        "n": len(asked),
        "pull_outs": asked.groupby("pull_out")["sample_id"].nunique().to_dict(),
        "groups": group.nunique(),
        "already_passed": int(passed.sum()),
        "censored": int((~passed & ~seen).sum()),
        "base_rate": truth.mean(),
        "brier_of_base_rate": truth.mean() * (1 - truth.mean()),
        "auroc": value,
        "auroc_low": max(value - half, 0.0),
        "auroc_high": min(value + half, 1.0),
        "brier": brier_score_loss(truth, answer),
        "curve": calibration_curve(truth, answer, n_bins=10),
        "shares": np.histogram(answer, bins=10, range=(0, 1))[0],
    }


def test_every_figure_can_be_recomputed(written: tuple[Evaluation, Path]) -> None:
    content = json.loads((written[1] / "metrics.json").read_text())["passing"]
    table = pd.read_parquet(written[1] / "predictions.parquet")
    table["own"] = table["p_overtake"] / (table["p_overtake"] + table["p_left_lane_change"])
    assert [part["within_s"] for part in content] == [5.0, 10.0]
    for part in content:
        within_s = part["within_s"]
        for k, answer in enumerate(part["answers"]):
            expected = recomputed(table[table["run"] == k], within_s, "own")
            for key in ("n", "pull_outs", "groups", "already_passed", "censored"):
                assert part[key] == expected[key]
            for key in ("base_rate", "brier_of_base_rate"):
                assert part[key] == pytest.approx(expected[key])
            for key in ("auroc", "auroc_low", "auroc_high"):
                assert answer[key] == pytest.approx(expected[key])
        trained = part["trained"]
        expected = recomputed(table[table["run"] == 1], within_s, f"p_pass_within_{within_s:g}_s")
        for key in ("auroc", "auroc_low", "auroc_high", "brier"):
            assert trained[key] == pytest.approx(expected[key])
        bins = trained["reliability"]
        shares, means = expected["curve"]
        np.testing.assert_allclose([row["share_passed"] for row in bins], shares)
        np.testing.assert_allclose([row["mean_probability"] for row in bins], means)
        assert [row["n"] for row in bins] == [n for n in expected["shares"] if n]
        gaps = [abs(row["share_passed"] - row["mean_probability"]) * row["n"] for row in bins]
        assert trained["calibration_error"] == pytest.approx(sum(gaps) / part["n"])
    assert set(content[0]["pull_outs"]) == {"overtaken", "not_passed", "passed_did_not_return", "unresolved"}
    assert min(content[0][key] for key in ("already_passed", "censored")) >= 0
    assert content[1]["censored"] > content[0]["censored"]


def test_what_can_be_learned_is_learned_and_the_result_is_read_back(written: tuple[Evaluation, Path]) -> None:
    evaluation, out = written
    assert read_metrics(out) == evaluation.result
    passing = evaluation.result.passing
    assert passing is not None
    for part in passing:
        assert part.trained is not None
        assert part.trained.auroc is not None
        assert part.trained.auroc > 0.75
        assert part.trained.brier < part.brier_of_base_rate


def test_no_other_score_sees_the_dropped_pull_outs(
    written: tuple[Evaluation, Path], records: Records, trees_run: Run, network_run: Run, tmp_path: Path
) -> None:
    without = evaluate_records(trees_run, records, MADE_OF, tmp_path / "report", SETTINGS, [network_run])
    assert "passing" not in json.loads((tmp_path / "report" / "metrics.json").read_text())
    assert without.result == written[0].result.model_copy(update={"passing": None})
    before, after = (pd.read_parquet(folder / "predictions.parquet") for folder in (tmp_path / "report", written[1]))
    dropped = after[after["windows"] == "dropped_pull_out"]
    assert len(dropped) > 0
    assert not dropped["known"].any()
    assert not set(dropped["sample_id"]) & set(before["sample_id"])
    rest = after.drop(index=dropped.index).reset_index(drop=True)
    pd.testing.assert_frame_equal(rest[before.columns], before)


def test_answers_of_test_seeds_teach_nothing(
    written: tuple[Evaluation, Path], records: Records, pull_outs: PullOuts, trees_run: Run
) -> None:
    evaluation, _ = written
    passing = evaluation.passing
    assert passing is not None
    test = pull_outs.table.index.str.rpartition("-").get_level_values(0).isin(trees_run.card.split["test"])
    turned = pull_outs.table.copy()
    turned.loc[test, "t_pass"] = np.nan
    assert 0 < test.sum() < len(test)
    windows = trees_run.card.settings.windows
    again = ask(replace(pull_outs, table=turned), records, evaluation.measured[0], windows, SETTINGS)
    for within_s, probability in passing.probability.items():
        np.testing.assert_array_equal(again.probability[within_s], probability)
    # Without an answer of either kind on the validation side, nothing can be calibrated.
    seen = pull_outs.table.index.str.rpartition("-").get_level_values(0).isin(trees_run.card.split["validation"])
    turned = pull_outs.table.copy()
    turned.loc[seen, "t_pass"] = np.nan
    assert seen.sum() > LEAST_OF_EACH
    assert not ask(replace(pull_outs, table=turned), records, evaluation.measured[0], windows, SETTINGS).models


def test_the_calibration_is_a_logistic_regression_that_never_turns_the_ranking_round() -> None:
    rng = np.random.default_rng(1)
    log_odds = rng.normal(0.5, 3.0, 400)
    answer = rng.random(400) < expit(0.4 * log_odds - 1.0)
    scale, shift = fit_calibration(log_odds, answer)
    expected = LogisticRegression(C=1e9).fit(log_odds[:, None], answer)
    assert scale == pytest.approx(expected.coef_[0, 0], abs=1e-3)
    assert shift == pytest.approx(expected.intercept_[0], abs=1e-3)
    scale, shift = fit_calibration(-log_odds, answer)
    assert scale == pytest.approx(LEAST_SCALE)
    assert expit(shift) == pytest.approx(answer.mean(), abs=0.01)


def test_where_traffic_keeps_left_an_overtake_is_weighed_against_a_right_change(
    written: tuple[Evaluation, Path], pull_outs: PullOuts
) -> None:
    keeping_right = written[0].measured[0]
    assert keeping_right.dropped is not None
    parts = [
        replace(part, keeps_left=np.ones(len(part.label), dtype=bool))
        for part in (keeping_right.predictions, keeping_right.dropped)
    ]
    answer = own_answer(pull_outs, replace(keeping_right, predictions=parts[0], dropped=parts[1]))
    sampled, dropped = (part.outputs.probabilities for part in parts)
    expected = np.concatenate([sampled[pull_outs.among(parts[0].sample_id)], dropped])
    np.testing.assert_allclose(answer, expected[:, 3] / (expected[:, 3] + expected[:, 2]))


def test_a_run_that_never_saw_an_overtake_has_no_answer(written: tuple[Evaluation, Path], pull_outs: PullOuts) -> None:
    measured = written[0].measured[0]
    settings = measured.run.card.settings.model_copy(update={"held_out": "overtake"})
    run = replace(measured.run, card=measured.run.card.model_copy(update={"settings": settings}))
    assert own_answer(pull_outs, measured) is not None
    assert own_answer(pull_outs, replace(measured, run=run)) is None
    passing = written[0].passing
    assert passing is not None
    [answer] = pass_scores(passing, [replace(measured, run=run)])[0].answers
    assert (answer.name, answer.auroc, answer.auroc_low) == ("boosted trees", None, None)


def test_without_windows_to_ask_or_to_learn_from_nothing_is_said(
    written: tuple[Evaluation, Path], records: Records, pull_outs: PullOuts, trees_run: Run
) -> None:
    """Test seeds without pull-outs; and a dataset without the seeds that the run was trained on."""
    measured, windows = written[0].measured[0], trees_run.card.settings.windows
    test = trees_run.card.split["test"]
    unasked = replace(
        pull_outs,
        table=pull_outs.table[~pull_outs.table.index.str.rpartition("-").get_level_values(0).isin(test)],
        dropped=pull_outs.dropped.take(~np.isin(pull_outs.dropped.groups, test)),
    )
    passing = ask(unasked, records, measured, windows, SETTINGS)
    assert len(passing.windows) == 0
    for part in pass_scores(passing, [replace(measured, dropped=None)]):
        assert (part.n, part.groups, part.pull_outs, part.base_rate) == (0, 0, {}, None)
        assert part.answers[0].auroc is None
        assert part.trained is not None
        assert (part.trained.auroc, part.trained.brier, part.trained.reliability) == (None, None, [])
    elsewhere = trees_run.card.model_copy(update={"split": {"train": ["road-1"], "validation": ["road-2"]}})
    stranger = replace(measured, run=replace(trees_run, card=elsewhere))
    passing = ask(pull_outs, records, stranger, windows, SETTINGS)
    assert not passing.models
    scores = pass_scores(passing, [stranger])
    assert all(part.trained is None and part.answers[0].auroc is not None for part in scores)
