"""The report: its table, its sentences, and one page that needs no other file."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from isacsim.scenarios.lane import Lane
from isacsim.scenarios.scenario import Site
from models.data.windows import Records
from models.evaluation.evaluation import Evaluation, evaluate_records
from models.evaluation.results import EvaluationResult, Interval, PairedDifference
from models.evaluation.settings import EvaluateSettings, WindowEndCurveSettings
from models.report.evaluation_figures import draw_figures
from models.report.record_view import draw_record
from models.report.report import record_view, table, verdict, write_page
from models.run import Run
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
    """The result with another difference in macro-F1 to the compared run, by so many test seeds."""
    (other,) = result.compared
    gap = Interval(difference=difference, low=low, high=high)
    paired = PairedDifference(groups=groups, macro_f1=gap, per_class_f1=dict.fromkeys(result.classes, gap))
    return result.model_copy(update={"compared": [other.model_copy(update={"paired_difference": paired})]})


def printed(result: EvaluationResult) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(table(result))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_the_table_and_the_page_say_the_same(result: EvaluationResult, tmp_path: Path) -> None:
    page = write_page(result, tmp_path).read_text()
    for name in result.classes:
        value = f"{result.per_class_f1[name]:.3f}"
        row = next(line for line in printed(result).splitlines() if name.replace("_", " ") in line)
        assert value in row
        assert f"<td>{name.replace('_', ' ')}</td><td>{value}</td>" in page
    assert f"{result.macro_f1:.3f}" in printed(result)


def test_the_verdict_names_the_winner_where_the_interval_leaves_no_doubt(result: EvaluationResult) -> None:
    name, other = result.name, result.compared[0].name
    assert verdict(with_difference(result, 5, 0.04, 0.01, 0.07)) == [f"{name} is ahead of {other} by 0.040 macro-F1."]
    assert verdict(with_difference(result, 5, -0.04, -0.07, -0.01)) == [
        f"{other} is ahead of {name} by 0.040 macro-F1."
    ]
    assert verdict(with_difference(result, 5, 0.04, -0.01, 0.07)) == [
        f"{name} is ahead of {other} by 0.040 macro-F1, but the interval includes 0."
    ]


def test_a_single_test_seed_says_nothing_about_the_difference(result: EvaluationResult, tmp_path: Path) -> None:
    single = with_difference(result, 1, 0.04, 0.04, 0.04)
    (sentence,) = verdict(single)
    assert "is ahead" not in sentence
    assert sentence.endswith("but with a single test seed nothing can be said about the difference.")
    assert "+0.040 (no interval)" in printed(single)
    page = write_page(single, tmp_path).read_text()
    assert sentence in page
    assert "bootstrap" not in page
    assert "+0.040 to" not in page


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
    assert len(sources) == len(list(tmp_path.glob("*.png"))) == 6
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "href" not in page
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


def test_a_record_s_view_predicts_every_window_that_fits(records: Records, network_run: Run) -> None:
    view = record_view(network_run, records, records.tv[1], 1)
    assert view.probabilities is not None
    assert view.t_end is not None
    assert view.probabilities.shape == (len(view.t_end), 6)
    assert view.t_end[0] == pytest.approx(-2.6 + 1.2)
    assert np.diff(view.t_end) == pytest.approx(0.05)
    assert view.t_end[-1] <= view.t_uv[-1]
