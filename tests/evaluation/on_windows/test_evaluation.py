"""Evaluation: the contract's keys, unseen seeds only, scores against independent computations."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics import f1_score, roc_auc_score

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.predictions import predict, unseen
from isac_cosim.evaluation.on_windows.results import EvaluationResult, MeasuredWindows, read_metrics
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings, WindowEndCurveSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Ends, Records, cut, draw_ends
from isac_cosim.models.runs.run import Run
from isac_cosim.models.scores import open_set
from tests.support.made_up import MADE_OF, make_records

TWICE = EvaluateSettings(ends_per_record=2)


@pytest.fixture(scope="module")
def evaluated(
    records: Records, network_run: Run, trees_run: Run, tmp_path_factory: pytest.TempPathFactory
) -> tuple[EvaluationResult, Path]:
    out = tmp_path_factory.mktemp("evaluation") / "report"
    return evaluate_records(network_run, records, MADE_OF, out, TWICE, [trees_run]).result, out


def test_metrics_json_holds_the_contract_and_what_made_it(evaluated: tuple[EvaluationResult, Path]) -> None:
    result, out = evaluated
    content = json.loads((out / "metrics.json").read_text())
    contract = {"n", "accuracy", "macro_f1", "per_class_f1", "confusion", "auroc_unknown", "by_lead_time", "by_snr"}
    assert contract <= set(content)
    made_by = content["made_by"]
    assert made_by["dataset"] == MADE_OF
    assert made_by["versions"]["torch"]
    assert [run["settings"]["model"] for run in made_by["runs"]] == ["asi-bip", "trees"]
    assert made_by["runs"][1]["best_epoch"] is None
    # Parts that do not apply are absent, not null.
    assert not {"held_out", "by_window_end", "over_training_seeds"} & set(content)
    assert content["windows"]["window_end_curve"] is None
    assert read_metrics(out) == result


def test_metrics_under_the_former_name_of_a_key_are_read(
    evaluated: tuple[EvaluationResult, Path], tmp_path: Path
) -> None:
    result, out = evaluated
    content = json.loads((out / "metrics.json").read_text())
    del content["windows"]["window_end_curve"]
    curve = {"relative_to": "commit", "first_s": -1.0, "last_s": 1.0, "step_s": 0.5}
    (tmp_path / "metrics.json").write_text(json.dumps({**content, "windows": {**content["windows"], "sweep": curve}}))
    stored = read_metrics(tmp_path)
    assert stored is not None
    assert stored.windows.window_end_curve == WindowEndCurveSettings(**curve)
    assert stored.by_lead_time == result.by_lead_time
    assert read_metrics(tmp_path / "nowhere") is None


def test_damaged_metrics_are_refused(evaluated: tuple[EvaluationResult, Path], tmp_path: Path) -> None:
    content = json.loads((evaluated[1] / "metrics.json").read_text())
    (tmp_path / "metrics.json").write_text(json.dumps({**content, "macro_f1": "high"}))
    with pytest.raises(InputError, match=r"metrics\.json: macro_f1"):
        read_metrics(tmp_path)


def test_settings_take_the_former_name_of_the_window_end_curve() -> None:
    curve = {"relative_to": "commit"}
    assert EvaluateSettings.model_validate({"sweep": curve}) == EvaluateSettings.model_validate(
        {"window_end_curve": curve}
    )
    with pytest.raises(ValueError, match="sweep"):
        EvaluateSettings.model_validate({"sweep": curve, "window_end_curve": curve})
    assert set(EvaluateSettings().model_dump()) == set(MeasuredWindows.model_fields) - {
        "window_s", "relative_to", "frame",
    }  # fmt: skip


def test_only_unseen_seeds_are_measured(evaluated: tuple[EvaluationResult, Path], network_run: Run) -> None:
    split = network_run.card.split
    assert evaluated[0].made_by.seeds == split["test"]


def test_the_scores_are_those_of_the_run_s_predictions(
    evaluated: tuple[EvaluationResult, Path], records: Records, network_run: Run
) -> None:
    result, _ = evaluated
    left = records.take(np.isin(records.groups, network_run.card.split["test"]))
    windows = network_run.card.settings.windows
    ends = draw_ends(left, windows, "evaluate", 0, per_record=2)
    outputs = network_run.predictor(cut(left, ends, windows))
    label, known = left.label[ends.row], left.label[ends.row] < 6
    predicted = outputs.logits.argmax(axis=1)
    assert result.n == known.sum()
    assert result.macro_f1 == pytest.approx(f1_score(label[known], predicted[known], average="macro"))
    assert result.unknown_scores["msp"].auroc == pytest.approx(roc_auc_score(known, outputs.probabilities.max(axis=1)))
    assert sum(row.n for row in result.by_lead_time) == known.sum()
    assert sum(row.n for row in result.by_snr) == known.sum()


def test_lead_time_is_commit_minus_end(records: Records, network_run: Run) -> None:
    ends = draw_ends(records, network_run.card.settings.windows, "test")[:10]
    predictions = predict(network_run, records, ends)
    commit = records.table["t_commit"].to_numpy()[ends.row]
    np.testing.assert_allclose(predictions.lead_s, commit - ends.times(records))


def test_the_unknown_score_was_chosen_on_validation_seeds(
    network_run: Run, evaluated: tuple[EvaluationResult, Path]
) -> None:
    card = network_run.card
    assert set(card.validation_auroc) == set(open_set.SCORES)
    assert card.validation_auroc[card.unknown_score] == max(card.validation_auroc.values())
    result, _ = evaluated
    assert result.auroc_unknown == result.unknown_scores[card.unknown_score].auroc


def test_the_unknown_against_lead_time_and_the_hard_pair(
    evaluated: tuple[EvaluationResult, Path], records: Records, network_run: Run
) -> None:
    result, _ = evaluated
    card = network_run.card
    left = records.take(np.isin(records.groups, card.split["test"]))
    predictions = predict(network_run, left, draw_ends(left, card.settings.windows, "evaluate", 0, per_record=2))
    score = open_set.chosen(network_run)(predictions.outputs)
    following = predictions.label == Intention.FOLLOWING
    for row in result.by_lead_time:
        in_bin = ~following & (predictions.lead_s >= row.from_s) & (predictions.lead_s < row.to_s)
        truth = np.concatenate([np.ones(in_bin.sum()), np.zeros(following.sum())])
        values = np.concatenate([score[in_bin], score[following]])
        assert row.auroc_unknown == pytest.approx(roc_auc_score(truth, values))
        assert row.fpr_at_95_recall == pytest.approx((score[following] >= np.quantile(score[in_bin], 0.05)).mean())
    pair = result.overtake_against_left
    logits = predictions.outputs.logits[:, [Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE]]
    for k, intention in enumerate((Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)):
        likelier = logits[predictions.label == intention].argmax(axis=1)
        assert pair.confusion[k] == [(likelier == 0).sum(), (likelier == 1).sum()]
    assert pair.n == np.sum(pair.confusion)
    assert pair.accuracy == pytest.approx(np.trace(pair.confusion) / pair.n)


def test_a_range_of_window_ends_of_its_own(records: Records, network_run: Run, tmp_path: Path) -> None:
    settings = EvaluateSettings(ends_per_record=1, end_after_s=(2.0, 2.2))
    result = evaluate_records(network_run, records, MADE_OF, tmp_path / "late", settings).result
    # Commits of the made-up records lie 0.3 to 2.0 s after onset.
    assert result.by_lead_time[-1].to_s <= 0.2
    assert result.windows.end_after_s == (2.0, 2.2)


def test_what_cannot_be_measured_is_refused(records: Records, network_run: Run, tmp_path: Path) -> None:
    seen = np.isin(records.groups, network_run.card.split["train"])
    with pytest.raises(InputError, match="other seeds"):
        unseen(records.take(seen), [network_run])
    slower = Records(records.tv, records.uv[:, :, ::2], 400.0, 50.0, records.table)
    with pytest.raises(InputError, match="rates"):
        evaluate_records(network_run, slower, MADE_OF, tmp_path / "slow", TWICE)
    (tmp_path / "foreign.txt").write_text("foreign")
    with pytest.raises(InputError, match="is not empty and holds no evaluation"):
        evaluate_records(network_run, records, MADE_OF, tmp_path, TWICE)


def test_other_traffic_is_all_unseen(network_run: Run) -> None:
    other = make_records(2, 1)
    other.table["scenario"] = "elsewhere"
    assert len(unseen(other, [network_run])) == len(other)


def test_seeds_that_a_training_share_left_out_are_not_measured(records: Records, network_run: Run) -> None:
    split = network_run.card.split
    fewer = {**split, "train": split["train"][:1], "unused": split["train"][1:]}
    run = replace(network_run, card=network_run.card.model_copy(update={"split": fewer}))
    assert sorted(set(unseen(records, [run]).groups)) == split["test"]


def test_the_same_evaluation_writes_the_same_bytes(
    evaluated: tuple[EvaluationResult, Path], records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    _, out = evaluated
    evaluate_records(network_run, records, MADE_OF, tmp_path / "again", TWICE, [trees_run])
    assert (tmp_path / "again" / "metrics.json").read_bytes() == (out / "metrics.json").read_bytes()


def test_maneuvers_with_background_count_the_rejected_and_the_following(
    evaluated: tuple[EvaluationResult, Path], records: Records, network_run: Run
) -> None:
    result, _ = evaluated
    card = network_run.card
    left = records.take(np.isin(records.groups, card.split["test"]))
    ends = draw_ends(left, card.settings.windows, "evaluate", 0, per_record=2)
    predictions = predict(network_run, left, ends)
    assert card.unknown_threshold is not None
    rejected = open_set.chosen(network_run)(predictions.outputs) < card.unknown_threshold
    assert 0 < rejected.sum() < len(rejected)
    kept = np.where(rejected, 6, predictions.predicted)
    recalls = [(kept[predictions.label == g] == g).mean() for g in range(6)]
    precisions = [(predictions.label[kept == g] == g).mean() if (kept == g).any() else 0 for g in range(6)]
    assert result.maneuvers_with_background.recall == pytest.approx(np.mean(recalls))
    assert result.maneuvers_with_background.precision == pytest.approx(np.mean(precisions))
    plain = [(predictions.predicted[predictions.label == g] == g).mean() for g in range(6)]
    assert result.maneuvers.recall == pytest.approx(np.mean(plain))


def test_the_default_window_end_curve_is_from_before_onset_to_a_window_after_it() -> None:
    ends = WindowEndCurveSettings().ends_s
    assert len(ends) == 14
    np.testing.assert_allclose(ends, np.arange(14) * 0.2 - 0.5)
    assert WindowEndCurveSettings(last_s=2.1).ends_s == ends


@pytest.mark.parametrize("relative_to", ["onset", "commit"])
def test_the_window_end_curve_measures_at_fixed_ends(
    relative_to: str, records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    curve = WindowEndCurveSettings(relative_to=relative_to, first_s=-0.4, last_s=7, step_s=1.0)  # type: ignore[arg-type]
    settings = EvaluateSettings(ends_per_record=1, window_end_curve=curve)
    result = evaluate_records(network_run, records, MADE_OF, tmp_path / "out", settings, [trees_run]).result
    left = records.take(np.isin(records.groups, network_run.card.split["test"]))
    points, others = result.by_window_end, result.compared[0].by_window_end
    assert points is not None
    assert others is not None
    # Records end 2.4 s after onset: later ends are in none of them.
    assert [point.end_s for point in points] == [-0.4, 0.6, 1.6]
    assert [point.end_s for point in others] == [point.end_s for point in points]
    since = left.table[f"t_{relative_to}"].to_numpy() - left.table["t_start"].to_numpy()
    for point in points:
        step = np.round((since + point.end_s) * 100).astype(int)
        usable = (step <= 499) & (step >= 119)
        windows = cut(left, Ends(np.flatnonzero(usable), step[usable]), network_run.card.settings.windows)
        label = left.label[usable]
        predicted = network_run.predictor(windows).logits.argmax(axis=1)
        assert point.n == (label < 6).sum()
        assert point.accuracy == pytest.approx((predicted == label)[label < 6].mean())
    assert points[0].accuracy is not None
    assert points[-1].accuracy is not None
    assert points[0].accuracy < points[-1].accuracy
    following = left.label == Intention.FOLLOWING
    late = cut(left, Ends(np.flatnonzero(usable), step[usable]), network_run.card.settings.windows)
    score = open_set.chosen(network_run)(network_run.predictor(late))
    kept = np.quantile(score[~following[usable]], 0.05)
    assert points[-1].fpr_at_95_recall == pytest.approx((score[following[usable]] >= kept).mean())
    assert read_metrics(tmp_path / "out") == result
