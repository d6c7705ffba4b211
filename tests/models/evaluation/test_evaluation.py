"""Evaluation and report: the contract's keys, unseen seeds only, figures, one page."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from sklearn.metrics import f1_score, roc_auc_score

from isacsim.errors import InputError
from isacsim.scenarios.lane import Lane
from isacsim.scenarios.scenario import Site
from labeling.intentions import Intention
from models.data.windows import Ends, Records, cut, draw_ends
from models.evaluation.evaluation import EvaluateSettings, SweepSettings, evaluate_records
from models.evaluation.predictions import answers, unseen
from models.report.record_view import draw_record
from models.report.report import record_view, table, verdict, write_page
from models.run import Run
from models.scores import open_set
from tests.support.made_up import MADE_OF, make_records

TWICE = EvaluateSettings(ends_per_record=2)


@pytest.fixture(scope="module")
def evaluated(
    records: Records, network_run: Run, trees_run: Run, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, Any], Path]:
    out = tmp_path_factory.mktemp("evaluation") / "report"
    return evaluate_records(network_run, records, MADE_OF, out, TWICE, [trees_run]), out


def test_metrics_json_holds_the_contract_and_what_made_it(evaluated: tuple[dict[str, Any], Path]) -> None:
    found, out = evaluated
    assert json.loads((out / "metrics.json").read_text()) == found
    contract = {"n", "accuracy", "macro_f1", "per_class_f1", "confusion", "auroc_unknown", "by_lead_time", "by_snr"}
    assert contract <= set(found)
    made_by = found["made_by"]
    assert made_by["dataset"] == MADE_OF
    assert made_by["versions"]["torch"]
    assert [run["settings"]["model"] for run in made_by["runs"]] == ["asi-bip", "trees"]


def test_only_unseen_seeds_are_measured(evaluated: tuple[dict[str, Any], Path], network_run: Run) -> None:
    split = network_run.card.split
    assert evaluated[0]["made_by"]["seeds"] == split["test"]


def test_the_figures_are_those_of_the_predictors_own_answers(
    evaluated: tuple[dict[str, Any], Path], records: Records, network_run: Run
) -> None:
    found, _ = evaluated
    left = records.take(np.isin(records.groups, network_run.card.split["test"]))
    windows = network_run.card.settings.windows
    ends = draw_ends(left, windows, "evaluate", 0, per_record=2)
    outputs = network_run.predictor(cut(left, ends, windows))
    label, known = left.label[ends.row], left.label[ends.row] < 6
    predicted = outputs.logits.argmax(axis=1)
    assert found["n"] == known.sum()
    assert found["macro_f1"] == pytest.approx(f1_score(label[known], predicted[known], average="macro"))
    assert found["unknown_scores"]["msp"]["auroc"] == pytest.approx(
        roc_auc_score(known, outputs.probabilities.max(axis=1))
    )
    assert sum(row["n"] for row in found["by_lead_time"]) == known.sum()
    assert sum(row["n"] for row in found["by_snr"]) == known.sum()


def test_lead_time_is_commit_minus_end(records: Records, network_run: Run) -> None:
    ends = draw_ends(records, network_run.card.settings.windows, "test")[:10]
    given = answers(network_run, records, ends)
    commit = records.table["t_commit"].to_numpy()[ends.row]
    np.testing.assert_allclose(given.lead_s, commit - ends.times(records))


def test_the_unknown_score_was_chosen_on_validation_seeds(
    network_run: Run, evaluated: tuple[dict[str, Any], Path]
) -> None:
    card = network_run.card
    assert set(card.validation_auroc) == set(open_set.SCORES)
    assert card.validation_auroc[card.unknown_score] == max(card.validation_auroc.values())
    found, _ = evaluated
    assert found["auroc_unknown"] == found["unknown_scores"][card.unknown_score]["auroc"]


def test_the_unknown_against_lead_time_and_the_hard_pair(
    evaluated: tuple[dict[str, Any], Path], records: Records, network_run: Run
) -> None:
    found, _ = evaluated
    card = network_run.card
    left = records.take(np.isin(records.groups, card.split["test"]))
    given = answers(network_run, left, draw_ends(left, card.settings.windows, "evaluate", 0, per_record=2))
    score = open_set.chosen(network_run)(given.outputs)
    following = given.label == Intention.FOLLOWING
    for row in found["by_lead_time"]:
        here = ~following & (given.lead_s >= row["from_s"]) & (given.lead_s < row["to_s"])
        truth = np.concatenate([np.ones(here.sum()), np.zeros(following.sum())])
        values = np.concatenate([score[here], score[following]])
        assert row["auroc_unknown"] == pytest.approx(roc_auc_score(truth, values))
        assert row["fpr_at_95_recall"] == pytest.approx((score[following] >= np.quantile(score[here], 0.05)).mean())
    pair = found["overtake_against_left"]
    logits = given.outputs.logits[:, [Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE]]
    for k, intention in enumerate((Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)):
        said = logits[given.label == intention].argmax(axis=1)
        assert pair["confusion"][k] == [(said == 0).sum(), (said == 1).sum()]
    assert pair["n"] == np.sum(pair["confusion"])
    assert pair["accuracy"] == pytest.approx(np.trace(pair["confusion"]) / pair["n"])


def test_a_range_of_window_ends_of_its_own(records: Records, network_run: Run, tmp_path: Path) -> None:
    settings = EvaluateSettings(ends_per_record=1, end_after_s=(2.0, 2.2))
    found = evaluate_records(network_run, records, MADE_OF, tmp_path / "late", settings)
    # Commits of the made-up records lie 0.3 to 2.0 s after onset.
    assert found["by_lead_time"][-1]["to_s"] <= 0.2
    assert found["windows"]["end_after_s"] == [2.0, 2.2]


def test_what_cannot_be_measured_is_refused(records: Records, network_run: Run, tmp_path: Path) -> None:
    seen = np.isin(records.groups, network_run.card.split["train"])
    with pytest.raises(InputError, match="other seeds"):
        unseen(records.take(seen), [network_run])
    slower = Records(records.tv, records.uv[:, :, ::2], 400.0, 50.0, records.table)
    with pytest.raises(InputError, match="rates"):
        evaluate_records(network_run, slower, MADE_OF, tmp_path / "slow", TWICE)
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"metrics\.json"):
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


def test_the_table_and_the_page_say_the_same(evaluated: tuple[dict[str, Any], Path]) -> None:
    found, out = evaluated
    console = Console(file=io.StringIO(), width=200)
    console.print(table(found))
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    page = write_page(found, out).read_text()
    for name in found["classes"]:
        value = f"{found['per_class_f1'][name]:.3f}"
        row = next(line for line in printed.splitlines() if name.replace("_", " ") in line)
        assert value in row
        assert f"<td>{name.replace('_', ' ')}</td><td>{value}</td>" in page
    assert f"{found['macro_f1']:.3f}" in printed


def test_the_verdict_names_the_winner(evaluated: tuple[dict[str, Any], Path]) -> None:
    found, _ = evaluated
    floor = found["compared"][0]
    ahead = found["name"] if found["macro_f1"] > floor["macro_f1"] else floor["name"]
    assert verdict(found)[0].startswith(f"{ahead} is ahead")


def test_the_page_needs_no_other_file_and_shows_every_figure(
    evaluated: tuple[dict[str, Any], Path], records: Records, network_run: Run
) -> None:
    found, out = evaluated
    row = int(np.flatnonzero(records.label == 3)[0])
    view = record_view(network_run, records, records.tv[row], row)
    lanes = [Lane("a", "e", 0, 3.2, 900.0, np.array([[0.0, 0.0], [900.0, 0.0]]), ())]
    draw_record(view, lanes, [Site("s", 100, 20, 25, 0)], out / "record.png")
    page = write_page(found, out).read_text()
    sources = re.findall(r'src="([^"]+)"', page)
    assert len(sources) == len(list(out.glob("*.png"))) == 6
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "href" not in page


def test_a_record_s_view_asks_every_window_that_fits(records: Records, network_run: Run) -> None:
    view = record_view(network_run, records, records.tv[1], 1)
    assert view.said is not None
    assert view.t_said is not None
    assert view.said.shape == (len(view.t_said), 6)
    assert view.t_said[0] == pytest.approx(-2.6 + 1.2)
    assert np.diff(view.t_said) == pytest.approx(0.05)
    assert view.t_said[-1] <= view.t_uv[-1]


def test_the_same_evaluation_writes_the_same_bytes(
    evaluated: tuple[dict[str, Any], Path], records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    _, out = evaluated
    evaluate_records(network_run, records, MADE_OF, tmp_path / "again", TWICE, [trees_run])
    for name in ("metrics.json", "confusion.png", "lead_time.png"):
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes()


def test_maneuvers_with_background_count_the_rejected_and_the_following(
    evaluated: tuple[dict[str, Any], Path], records: Records, network_run: Run
) -> None:
    found, _ = evaluated
    card = network_run.card
    left = records.take(np.isin(records.groups, card.split["test"]))
    ends = draw_ends(left, card.settings.windows, "evaluate", 0, per_record=2)
    given = answers(network_run, left, ends)
    assert card.unknown_threshold is not None
    rejected = open_set.chosen(network_run)(given.outputs) < card.unknown_threshold
    assert 0 < rejected.sum() < len(rejected)
    said = np.where(rejected, 6, given.predicted)
    recalls = [(said[given.label == g] == g).mean() for g in range(6)]
    precisions = [(given.label[said == g] == g).mean() if (said == g).any() else 0 for g in range(6)]
    assert found["maneuvers_with_background"]["recall"] == pytest.approx(np.mean(recalls))
    assert found["maneuvers_with_background"]["precision"] == pytest.approx(np.mean(precisions))
    plain = [(given.predicted[given.label == g] == g).mean() for g in range(6)]
    assert found["maneuvers"]["recall"] == pytest.approx(np.mean(plain))


def test_the_default_sweep_is_from_before_onset_to_a_window_after_it() -> None:
    ends = SweepSettings().ends_s
    assert len(ends) == 14
    np.testing.assert_allclose(ends, np.arange(14) * 0.2 - 0.5)
    assert SweepSettings(last_s=2.1).ends_s == ends


@pytest.mark.parametrize("relative_to", ["onset", "commit"])
def test_a_sweep_measures_at_fixed_ends(
    relative_to: str, records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    sweep = SweepSettings(relative_to=relative_to, first_s=-0.4, last_s=7, step_s=1.0)  # type: ignore[arg-type]
    settings = EvaluateSettings(ends_per_record=1, sweep=sweep)
    found = evaluate_records(network_run, records, MADE_OF, tmp_path / "out", settings, [trees_run])
    left = records.take(np.isin(records.groups, network_run.card.split["test"]))
    rows = found["by_window_end"]
    # Records end 2.4 s after onset: later ends are in none of them.
    assert [row["end_s"] for row in rows] == [-0.4, 0.6, 1.6]
    assert [row["end_s"] for row in found["compared"][0]["by_window_end"]] == [row["end_s"] for row in rows]
    since = left.table[f"t_{relative_to}"].to_numpy() - left.table["t_start"].to_numpy()
    for row in rows:
        step = np.round((since + row["end_s"]) * 100).astype(int)
        usable = (step <= 499) & (step >= 119)
        windows = cut(left, Ends(np.flatnonzero(usable), step[usable]), network_run.card.settings.windows)
        label = left.label[usable]
        said = network_run.predictor(windows).logits.argmax(axis=1)
        assert row["n"] == (label < 6).sum()
        assert row["accuracy"] == pytest.approx((said == label)[label < 6].mean())
    assert rows[0]["accuracy"] < rows[-1]["accuracy"]
    assert (tmp_path / "out" / "window_end.png").stat().st_size > 5000
    assert (tmp_path / "out" / "unknown_window_end.png").stat().st_size > 5000
    following = left.label == Intention.FOLLOWING
    late = cut(left, Ends(np.flatnonzero(usable), step[usable]), network_run.card.settings.windows)
    score = open_set.chosen(network_run)(network_run.predictor(late))
    kept = np.quantile(score[~following[usable]], 0.05)
    assert rows[-1]["fpr_at_95_recall"] == pytest.approx((score[following[usable]] >= kept).mean())
