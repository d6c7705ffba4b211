"""Evaluation and report: the contract's keys, unseen seeds only, figures, one page."""

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import MADE_OF, make_records
from rich.console import Console
from sklearn.metrics import f1_score, roc_auc_score

from isacsim.errors import InputError
from isacsim.recording import Lane
from isacsim.scenario import Site
from models import openset
from models.evaluation import EvaluateSettings, answers, evaluate_records, unseen
from models.record_view import draw_record
from models.report import record_view, table, verdict, write_page
from models.run import Run
from models.windows import Records, cut, draw_ends

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
    assert set(card.validation_auroc) == set(openset.SCORES)
    assert card.validation_auroc[card.unknown_score] == max(card.validation_auroc.values())
    found, _ = evaluated
    assert found["auroc_unknown"] == found["unknown_scores"][card.unknown_score]["auroc"]


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
    assert len(sources) == len(list(out.glob("*.png"))) == 5
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
