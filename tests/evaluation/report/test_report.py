"""The report: its table, its sentences, and one page that needs no other file."""

import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from isac_cosim.evaluation.on_windows.evaluation import Evaluation, evaluate_records
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.on_windows.score_results import Difference, PairedDifference
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings, WindowEndCurveSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.record_view import draw_record
from isac_cosim.evaluation.report.report import record_view, show, write_page
from isac_cosim.evaluation.report.verdict import verdict
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from tests.support.made_up import MADE_OF

TWICE = EvaluateSettings(ends_per_record=2)


@pytest.fixture(scope="module")
def evaluation(
    records: Records, network_run: Run, trees_run: Run, tmp_path_factory: pytest.TempPathFactory
) -> Evaluation:
    return evaluate_records(
        network_run, records, MADE_OF, tmp_path_factory.mktemp("evaluation") / "out", TWICE, [trees_run]
    )


@pytest.fixture
def result(evaluation: Evaluation) -> EvaluationResult:
    return evaluation.result


def with_difference(result: EvaluationResult, groups: int, difference: float, low: float, high: float):
    """The result with another difference in macro-F1 before the commit to the compared run, by so many test seeds."""
    (other,) = result.compared
    gap = Difference(difference=difference, low=low, high=high)
    paired = PairedDifference(groups=groups, macro_f1=gap, per_class_f1=dict.fromkeys(result.classes, gap))
    compared = other.model_copy(update={"paired_difference_before_commit": paired})
    return result.model_copy(update={"compared": [compared]})


def printed(result: EvaluationResult) -> str:
    console = Console(file=io.StringIO(), width=200)
    show(result, Path(), console)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_the_table_and_the_page_say_the_same(result: EvaluationResult, tmp_path: Path) -> None:
    page, text = write_page(result, tmp_path).read_text(), printed(result)
    early = result.before_commit
    assert early is not None
    for name in result.classes:
        value = f"{early.per_class[name].f1:.3f}"
        row = next(line for line in text.splitlines() if name.replace("_", " ") in line)
        assert value in row
        assert f"{early.per_class[name].n} windows" in row
        assert re.search(rf"windows?</td><td>{value}</td>", page)
    for score in (early.macro_f1, result.after_commit.macro_f1, result.macro_f1, result.five_classes.macro_f1):
        assert f"{score:.3f}" in text
        assert f"{score:.3f}" in page
    (compared,) = result.compared
    for at_lead in early.by_lead:
        row = next(line for line in text.splitlines() if f"{at_lead.lead_s:g} s before: {at_lead.n} windows" in line)
        assert "2 test seeds" in row
        paired = compared.difference_at(at_lead.lead_s)
        assert paired is not None
        assert paired.groups == 2
        gap = paired.macro_f1
        if gap.low is not None:
            # An interval from -1 to 1 says nothing.
            between = "no interval" if gap.high - gap.low >= 2 else f"{gap.low:+.3f} to {gap.high:+.3f}"
            assert f"{gap.difference:+.3f} ({between})" in row
    assert any(compared.difference_at(at_lead.lead_s).macro_f1.low is not None for at_lead in early.by_lead)


def test_what_comes_first_is_prediction(result: EvaluationResult, tmp_path: Path) -> None:
    """Before the commit, then after it, then all windows; scores that saw no driving before the detector that did."""
    for text in (printed(result), write_page(result, tmp_path).read_text().partition("<details>")[2]):
        order = [
            text.index(words)
            for words in (
                "before the commit, 2 test seeds", "so long before the commit", "Recognition:", "as the papers count",
                "maximum softmax probability (ASI-BIP paper: 0.6994)", "mahalanobis", "Detector trained on pre-onset",
            )
        ]  # fmt: skip
        assert order == sorted(order)


def test_a_class_that_commits_at_once_says_so(result: EvaluationResult, tmp_path: Path) -> None:
    early = result.before_commit
    delay = early.onset_to_commit["hard_accel"].model_copy(update={"median_s": 0.12, "at_once": True})
    delays = {**early.onset_to_commit, "hard_accel": delay}
    sudden = result.model_copy(update={"before_commit": early.model_copy(update={"onset_to_commit": delays})})
    remark = "hard accel (commits 0.12 s after onset)"
    assert remark in printed(sudden)
    # In the table of all runs and in that by lead time.
    assert write_page(sudden, tmp_path).read_text().count(remark) == 2
    assert "commits" not in printed(result).replace("Prediction", "")


def test_a_result_of_an_earlier_version_still_makes_a_page(result: EvaluationResult, tmp_path: Path) -> None:
    new = ("before_commit", "after_commit", "five_classes", "groups", "macro_f1_low", "macro_f1_high")
    (compared,) = result.compared
    old = result.model_copy(
        update={
            **dict.fromkeys(new),
            "compared": [compared.model_copy(update={**dict.fromkeys(new), "paired_difference_before_commit": None})],
        }
    )
    assert f"{result.macro_f1:.3f}" in write_page(old, tmp_path).read_text()
    assert "Prediction" not in printed(old)
    assert "before the commit" not in verdict(old)[0]


def test_the_verdict_names_the_winner_where_the_interval_leaves_no_doubt(result: EvaluationResult) -> None:
    name, other = result.name, result.compared[0].name
    assert verdict(with_difference(result, 5, 0.04, 0.01, 0.07)) == [
        f"{name} came out ahead of {other} by 0.040 macro-F1 before the commit (5 test seeds)."
    ]
    assert verdict(with_difference(result, 5, -0.04, -0.07, -0.01)) == [
        f"{other.capitalize()} came out ahead of {name} by 0.040 macro-F1 before the commit (5 test seeds)."
    ]
    assert verdict(with_difference(result, 5, 0.04, -0.01, 0.07)) == [
        f"{name} came out ahead of {other} by 0.040 macro-F1 before the commit (5 test seeds), "
        "but the interval includes 0."
    ]


def test_two_test_seeds_allow_no_verdict(result: EvaluationResult) -> None:
    (sentence,) = verdict(with_difference(result, 2, 0.04, 0.01, 0.07))
    assert "is ahead" not in sentence
    assert "2 test seeds are too few" in sentence


def test_a_single_test_seed_says_nothing_about_the_difference(result: EvaluationResult, tmp_path: Path) -> None:
    single = with_difference(result, 1, 0.04, 0.04, 0.04)
    (sentence,) = verdict(single)
    assert "is ahead" not in sentence
    assert sentence.endswith("but with a single test seed nothing can be said about the difference.")
    assert "+0.040 (no interval)" in printed(single)
    page = write_page(single, tmp_path).read_text()
    assert sentence in page
    assert "jackknife" not in page
    assert "+0.040 to" not in page


def test_scores_of_a_single_test_seed_say_so(result: EvaluationResult, tmp_path: Path) -> None:
    remark = "All scores are of a single test seed: nothing can be said about other traffic."
    alone = result.model_copy(update={"groups": 1, "compared": []})
    assert verdict(alone) == [remark]
    assert remark in write_page(alone, tmp_path).read_text()
    assert remark not in verdict(result)
    assert remark not in write_page(result, tmp_path).read_text()


def test_differences_are_explained_only_where_runs_are_compared(result: EvaluationResult, tmp_path: Path) -> None:
    assert "Differences are paired" in write_page(result, tmp_path).read_text()
    alone = result.model_copy(update={"compared": []})
    assert "Differences are paired" not in write_page(alone, tmp_path).read_text()


def test_the_page_needs_no_other_file_and_shows_every_figure(
    evaluation: Evaluation, records: Records, network_run: Run, tmp_path: Path
) -> None:
    draw_figures(evaluation, tmp_path)
    row = int(np.flatnonzero(records.label == 3)[0])
    view = record_view(network_run, records, records.tv[row], row)
    lanes = [Lane("a", "e", 0, 3.2, 900.0, np.array([[0.0, 0.0], [900.0, 0.0]]), ())]
    draw_record(view, lanes, [Site("s", 100, 20, 25, 0)], tmp_path / "record.png")
    page = write_page(evaluation.result, tmp_path, "It was chosen by lot.").read_text()
    sources = re.findall(r'src="([^"]+)"', page)
    drawn = {path.stem for path in tmp_path.glob("*.png")}
    too_few_windows = {"lead_time", "unknown_lead_time"}
    assert too_few_windows < drawn
    assert len(sources) == len(drawn - too_few_windows) == 4
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert all(target.startswith("data:text/csv") for target in re.findall(r'href="([^"]+)"', page))
    assert "true motion. It was chosen by lot.</figcaption>" in page


def test_the_same_evaluation_draws_the_same_bytes(evaluation: Evaluation, tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        draw_figures(evaluation, tmp_path / name)
    for name in ("confusion.png", "lead_time.png"):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes()


def test_the_window_end_curve_is_drawn_where_it_was_measured(records: Records, trees_run: Run, tmp_path: Path) -> None:
    settings = EvaluateSettings(ends_per_record=1, window_end_curve=WindowEndCurveSettings(step_s=1.0))
    draw_figures(evaluate_records(trees_run, records, MADE_OF, tmp_path, settings), tmp_path)
    for name in ("window_end.png", "unknown_window_end.png"):
        assert (tmp_path / name).stat().st_size > 5000


def test_a_record_is_drawn_where_its_point_puts_it(records: Records, network_run: Run) -> None:
    """Roads and sites are in the plane, and so is what is drawn of a record."""
    moved = replace(records, table=records.table.assign(x0=20_000.0, y0=-300.0))
    here, there = (record_view(network_run, placed, placed.tv[1], 1) for placed in (records, moved))
    for name in ("tv", "truth", "uv"):
        shift = getattr(there, name) - getattr(here, name)
        np.testing.assert_allclose(shift[0], 20_000.0, atol=1e-9)
        np.testing.assert_allclose(shift[1], -300.0, atol=1e-9)
        np.testing.assert_array_equal(shift[2:], 0.0)
    np.testing.assert_allclose(there.probabilities, here.probabilities, atol=1e-4)


def test_a_record_s_view_predicts_every_window_that_fits(records: Records, network_run: Run) -> None:
    view = record_view(network_run, records, records.tv[1], 1)
    assert view.probabilities is not None
    assert view.t_end is not None
    assert view.probabilities.shape == (len(view.t_end), 6)
    assert view.t_end[0] == pytest.approx(-2.6 + 1.2)
    assert np.diff(view.t_end) == pytest.approx(0.05)
    assert view.t_end[-1] <= view.t_uv[-1]
