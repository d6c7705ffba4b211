"""The distribution of lead times: a row for each intention that has alarms, its median and quartiles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from isac_cosim.evaluation.report.live import live_figures
from isac_cosim.evaluation.report.live_parts import CAPTIONS, CHARTS, FROZEN, RATE, RECALL, LiveFigures
from isac_cosim.evaluation.report.parts import Row, Shown, read_table, write_table
from isac_cosim.labeling.intentions import KNOWN


def test_lead_times_show_median_and_quartiles_of_all_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    original = live_figures.figure

    @contextmanager
    def kept(path: Path, width: float, height: float) -> Iterator[Figure]:
        with original(path, width, height) as figure:
            drawn.append(figure)
            yield figure

    monkeypatch.setattr(live_figures, "figure", kept)
    first = {0: np.array([0.5, 1.5, np.nan]), 2: np.array([np.nan])}
    second = {0: np.array([1.0, -0.2, 2.0]), 3: np.array([0.7])}
    outcomes = [
        SimpleNamespace(of=lambda row, leads=leads: SimpleNamespace(to_commit=leads.get(row, np.empty(0))))
        for leads in (first, second)
    ]
    live_figures.lead_times(outcomes, tmp_path / "lead_times.png")
    assert (tmp_path / "lead_times.png").stat().st_size > 5000
    (axes,) = drawn[0].axes
    medians = {line.get_ydata()[0]: line.get_xdata()[0] for line in axes.lines if line.get_marker() == "D"}
    assert medians == {0: 1.0, 3: 0.7}
    bars = {tuple(line.get_ydata()): tuple(line.get_xdata()) for line in axes.lines if line.get_linewidth() == 2}
    assert bars[0, 0] == (0.5, 1.5)
    assert [label.get_text() for label in axes.get_yticklabels()] == [k.text.replace("_", " ") for k in KNOWN]


def test_the_table_of_the_curve_has_its_corners_and_the_frozen_alarms(tmp_path: Path) -> None:
    rates, recalls = np.array([4.0, 0.5, 1.0, 2.0, np.inf]), np.array([0.75, 0.25, 0.25, 0.5, 0.75])
    sweep = SimpleNamespace(thresholds=rates, rates=lambda: rates, recalls=lambda: recalls)
    frozen = SimpleNamespace(over_all=SimpleNamespace(false_alarms_per_vehicle_hour=1.5, recall=0.4))
    nothing = SimpleNamespace(over_all=SimpleNamespace(false_alarms_per_vehicle_hour=None, recall=None))
    shown = {
        "a": SimpleNamespace(sweep=sweep, result=frozen),
        "b": SimpleNamespace(sweep=None, result=frozen),
        "c": SimpleNamespace(sweep=None, result=nothing),
    }
    rows = list(live_figures._recall_rows(shown))  # type: ignore[arg-type]
    write_table(rows, tmp_path / "recall_against_false_alarms.csv")
    stored = read_table(tmp_path / "recall_against_false_alarms.csv")
    assert [(row["predictor"], row["alarms"], row[RATE], row[RECALL]) for row in stored] == [
        ("a", "any", 0.5, 0.25), ("a", "any", 2.0, 0.5), ("a", "any", 4.0, 0.75), ("a", "any", None, 0.75),
        ("a", FROZEN, 1.5, 0.4), ("b", FROZEN, 1.5, 0.4),
    ]  # fmt: skip
    (chart,) = CHARTS.values()
    lines = chart.content(stored)["lines"]
    assert [(line["name"], line["single"], line["x"]) for line in lines] == [
        ("a", False, [0.5, 2.0, 4.0]), ("a", True, [1.5]), ("b", True, [1.5]),
    ]  # fmt: skip
    assert seen_in(tmp_path)["recall_against_false_alarms.png"].endswith("a: 0.4 at 1.5; b: 0.4 at 1.5.")


def seen_in(folder: Path) -> Mapping[str, str]:
    """What those are told who do not see the figures of a folder."""
    (part,) = LiveFigures().parts(Shown(None, folder))
    return part.seen


def test_those_who_do_not_see_the_figures_are_told_what_is_in_them(tmp_path: Path) -> None:
    assert seen_in(tmp_path) == {}
    outcomes = [SimpleNamespace(of=lambda row: SimpleNamespace(to_commit=np.array([0.5, 1.5, 4.0, np.nan][: 4 - row])))]
    write_table(list(live_figures._lead_rows(outcomes)), tmp_path / "lead_times.csv")  # type: ignore[arg-type]
    events: list[Row] = [{"what": "event"}, {"what": "alarm"}, {"what": "event"}, {"what": "false alarm"}]
    write_table(events, tmp_path / "time_line.csv")
    seen = seen_in(tmp_path)
    assert "hard brake: 3 alarms, median 1.50 s" in seen[CAPTIONS[1][0]]
    assert seen[CAPTIONS[2][0]] == "2 events, 1 right or neutral alarm, 1 false alarm."
