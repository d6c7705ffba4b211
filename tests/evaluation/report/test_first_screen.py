"""What is seen first: three figures with intervals, F1 by intention, who is taken for whom, and in which records."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.evaluation.in_traffic.scores.results import HeadlineResult, TrafficResult
from isac_cosim.evaluation.on_windows.evaluation import Evaluation, evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.first_screen import ByIntention, ConfusionMatrix, confused
from isac_cosim.evaluation.report.page import write_page
from isac_cosim.evaluation.report.parts import Matrix, Part, Shown, counted, csv_text
from isac_cosim.evaluation.report.registry import parts_of
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.score_table import with_interval
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from tests.support.made_up import MADE_OF


@pytest.fixture(scope="module")
def evaluation(records: Records, trees_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Evaluation:
    folder = tmp_path_factory.mktemp("evaluation") / "out"
    return evaluate_records(trees_run, records, MADE_OF, folder, EvaluateSettings(ends_per_record=2))


def test_the_cells_hold_the_records_of_their_windows(evaluation: Evaluation) -> None:
    predictions, before = evaluation.measured[0].predictions, evaluation.result.before_commit
    assert before is not None
    cells = confused(predictions, evaluation.result)
    counts = np.array(before.confusion)
    assert {cell for cell in np.ndindex(*counts.shape) if counts[cell]} == set(cells)
    for (i, j), ids in cells.items():
        rows = predictions.before_commit & (predictions.label == i) & (predictions.predicted == j)
        assert len(ids) == len(set(ids))
        assert set(ids) == set(predictions.sample_id[rows])
        assert counts[i, j] == rows.sum() >= len(ids)


def test_the_first_parts_are_the_sentence_the_road_and_the_intentions(evaluation: Evaluation, tmp_path: Path) -> None:
    names = [part.name for part in parts_of(Shown(evaluation.result, tmp_path))]
    assert names[:3] == ["headline", "f1-by-intention", "confusion"]
    assert names.index("figures") < names.index("before-commit")


def test_natural_maneuvers_stand_apart(evaluation: Evaluation, tmp_path: Path) -> None:
    (part,) = ByIntention().parts(Shown(evaluation.result, tmp_path))
    before = evaluation.result.before_commit
    assert before is not None
    for name, row in zip(evaluation.result.classes, part.rows, strict=True):
        assert row["F1"].value == before.per_class[name].f1  # type: ignore[union-attr]
        assert row["F1, natural alone"].value == before.by_origin["natural"].per_class[name].f1  # type: ignore[union-attr]


def test_a_cell_opens_its_records_and_plays_those_of_the_replay(tmp_path: Path) -> None:
    matrix = Matrix(("a", "b"), [[1, 2], [0, 0]], {(0, 0): ["x-1-0"], (0, 1): ["x-1-1", "<i>-2-0"]}, {"x-1-1"}, 60)
    page = write_page("t", [Part("confusion", matrix=matrix)], "o", tmp_path).read_text()
    assert Counter(re.findall(r'data-cell="(cell-\d-\d)"', page)) == {"cell-0-0": 1, "cell-0-1": 1}
    assert re.findall(r'data-record="([^"]+)"', page) == ["x-1-1"]
    assert "a taken for b: 2 windows" in page
    assert "a taken for a: 1 window" in page
    assert "<li>&lt;i&gt;-2-0</li>" in page


def test_without_predictions_the_matrix_opens_nothing(evaluation: Evaluation, tmp_path: Path) -> None:
    (part,) = ConfusionMatrix().parts(Shown(evaluation.result, tmp_path))
    page = write_page("t", [part], "o", tmp_path).read_text()
    assert "data-cell=" not in page
    assert "opens" not in page


def test_an_interval_that_is_the_whole_range_is_left_out(evaluation: Evaluation) -> None:
    before = evaluation.result.before_commit
    assert before is not None
    whole = before.model_copy(update={"macro_f1": 0.5, "macro_f1_low": 0.0, "macro_f1_high": 1.0})
    assert with_interval(whole) == "0.500"
    assert with_interval(whole.model_copy(update={"macro_f1_high": 0.9})) == "0.500 (0.000 to 0.900)"


def test_one_is_singular(evaluation: Evaluation, tmp_path: Path) -> None:
    assert [counted(number, "window") for number in (0, 1, 2)] == ["0 windows", "1 window", "2 windows"]
    before = evaluation.result.before_commit
    assert before is not None
    one = {name: scores.model_copy(update={"n": 1}) for name, scores in before.per_class.items()}
    result = evaluation.result.model_copy(
        update={"before_commit": before.model_copy(update={"per_class": one, "n": 1})}
    )
    texts = " ".join(part.title + str(part.rows) for part in parts_of(Shown(result, tmp_path)))
    assert not re.search(r"\b1 windows", texts)


def test_tables_are_folded_and_can_be_taken_as_csv(evaluation: Evaluation, tmp_path: Path) -> None:
    parts = parts_of(Shown(evaluation.result, tmp_path))
    tables = [part for part in parts if part.rows and part.on_page]
    page = write_page("t", parts, "o", tmp_path).read_text()
    assert page.count("<details><summary>") == sum(part.folded for part in tables) + 1  # What made it.
    assert len(re.findall(r'href="data:text/csv;charset=utf-8;base64,', page)) == len(tables)


def test_every_scroll_area_and_picture_can_be_reached_and_read(evaluation: Evaluation, tmp_path: Path) -> None:
    (tmp_path / "confusion.png").write_bytes(b"png")
    (tmp_path / "lead_time.png").write_bytes(b"png")
    page = write_page("t", parts_of(Shown(evaluation.result, tmp_path)), "o", tmp_path).read_text()
    assert page.count('class="scroll"') == len(
        re.findall(r'class="scroll" role="region" tabindex="0" aria-label="[^"]+"', page)
    )
    for alt, caption in re.findall(r'<img alt="([^"]*)"[^>]*><figcaption>([^<]*)', page):
        assert alt
        assert alt.strip() != caption.strip()
    assert "lie on the diagonal" in page


def test_a_csv_reads_back() -> None:
    assert csv_text([{"a": 1, "b": 'x,"y'}, {"a": None}]) == 'a,b\r\n1,"x,""y"\r\n,\r\n'


def test_the_page_of_a_result_without_scores_before_the_commit_is_made(evaluation: Evaluation, tmp_path: Path) -> None:
    result = replace(
        Shown(evaluation.result, tmp_path), result=evaluation.result.model_copy(update={"before_commit": None})
    )
    page = write_page("t", parts_of(result), "o", tmp_path).read_text()
    assert "Numbers of all windows" in page


def test_a_live_evaluation_begins_with_its_three_figures(tmp_path: Path) -> None:
    stored = Path(cosim.__file__).parent / "docs" / "live" / "motorway_stimulated.json"
    scores = {"lead_s": None, "by_intention": {}, "false_alarms_per_vehicle_hour": 0.7, "recall": 0.5, "at": []}
    sure = HeadlineResult.model_construct(
        **scores,
        events=1,
        recall_interval=Interval(low=0.2, high=0.8),
        false_alarms_interval=Interval(low=0.25, high=1.15),
    )
    unsure = sure.model_copy(update={"events": 9, "recall_interval": Interval(low=0.0, high=1.0)})
    update = {"prediction": sure, "recognition": unsure}
    result = TrafficResult.model_validate_json(stored.read_text()).model_copy(update=update)
    moving = Replay("its worst moments", (), (), ())
    first, second, third = parts_of(Shown(result, tmp_path, replay=moving))[:3]
    assert (second.replay, third.replay) == (moving, None)
    assert first.numbers == [
        ("0.50 (0.20 to 0.80)", "of 1 event predicted by their commit"),
        ("0.50", "of 9 events recognised by 0.5 s after it"),
        ("0.70 (0.25 to 1.15)", "false alarms per vehicle-hour, of those that predict"),
    ]
    assert result.scenario in first.text
