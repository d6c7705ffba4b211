"""predictions.parquet: every figure of metrics.json, recomputed from it by scikit-learn and pandas alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings, WindowEndCurveSettings
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.recomputed_metrics import difference, differences_by_lead, repeated, scores

SETTINGS = EvaluateSettings(ends_per_record=3, window_end_curve=WindowEndCurveSettings(step_s=0.9))
DESCRIBED = {"model", "name", "classes", "unknown_score", "windows", "made_by"}
"""Keys that say what was measured and with what, rather than how it went."""


@pytest.fixture(scope="module")
def written(records: Records, network_run: Run, trees_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation with a compared run, a repeated one and a window-end curve."""
    folder = tmp_path_factory.mktemp("evaluation")
    trees = SMALL_RUN.model_copy(update={"model": "trees", "seed": 1})
    again = train_records(records, MADE_OF, folder / "again", trees)
    evaluate_records(trees_run, records, MADE_OF, folder / "report", SETTINGS, [network_run, again])
    return folder / "report"


@pytest.fixture(scope="module")
def held_out(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation of a run that never saw an overtake, on early windows."""
    folder = tmp_path_factory.mktemp("held_out")
    trees = SMALL_RUN.model_copy(update={"model": "trees", "held_out": "overtake"})
    settings = EvaluateSettings(ends_per_record=2, end_after_s=(-0.3, 1.0))
    evaluate_records(train_records(records, MADE_OF, folder / "run", trees), records, MADE_OF, folder / "out", settings)
    return folder / "out"


@pytest.fixture(scope="module")
def left_hand(records: Records, trees_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation where some of the traffic keeps left."""
    folder = tmp_path_factory.mktemp("left_hand")
    north = records.table["scenario"].mask(records.table.index % 3 == 0, "north")

    def lanes(name: str) -> LaneMap:
        inner_m = -3.2 if name == "north" else 3.2
        lines = [np.array([[0.0, y], [900.0, y]]) for y in (0.0, inner_m)]
        return LaneMap.of([Lane(f"e_{k}", "e", k, 3.2, 900.0, line, ()) for k, line in enumerate(lines)])

    mixed = replace(records, table=records.table.assign(scenario=north), lane_maps=lanes)
    assert set(mixed.keeps_left) == {True, False}
    evaluate_records(trees_run, mixed, MADE_OF, folder, SETTINGS)
    return folder


@pytest.mark.parametrize("evaluation", ["written", "held_out", "left_hand"])
def test_every_figure_can_be_recomputed(evaluation: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(evaluation)
    content = json.loads((folder / "metrics.json").read_text())
    table = pd.read_parquet(folder / "predictions.parquet")
    table["group"] = table["scenario"] + "-" + table["seed"].astype(str)
    temperature = [card["temperature"] for card in content["made_by"]["runs"]]
    runs = [table[table["run"] == k] for k in range(len(temperature))]
    expected = scores(runs[0], content, temperature[0])
    expected["compared"] = [
        scores(runs[k], compared, temperature[k])
        | {"paired_difference": difference([runs[0]], [runs[k]], content["classes"])}
        | {"paired_difference_before_commit": difference([runs[0]], [runs[k]], content["classes"], early=True)}
        | {"paired_difference_by_lead": differences_by_lead([runs[0]], [runs[k]], content["classes"])}
        for k, compared in enumerate(content["compared"], start=1)
    ]
    if evaluation == "written":
        results = [content, *content["compared"]]
        groups = {"boosted trees": [0, 2], "ASI-BIP": [1]}
        expected["over_training_seeds"] = [
            repeated(name, [results[k] for k in members]) for name, members in groups.items()
        ]
        expected["over_training_seeds"][1] |= {
            key: difference([runs[0], runs[2]], [runs[1]], content["classes"], early)
            for key, early in (("paired_difference", False), ("paired_difference_before_commit", True))
        }
        by_lead = differences_by_lead([runs[0], runs[2]], [runs[1]], content["classes"])
        expected["over_training_seeds"][1]["paired_difference_by_lead"] = by_lead
    assert_same(expected, content, "metrics.json")


def assert_same(expected: Any, content: Any, place: str) -> None:
    """Compare what was recomputed with what the file holds, key by key."""
    if isinstance(expected, dict):
        described = DESCRIBED if "made_by" in content or "model" in content else set()
        missing = {key for key, value in expected.items() if key not in content and value is not None}
        assert not missing, f"{place}: {missing}"
        assert set(content) - described <= set(expected), f"{place}: {set(content) - described - set(expected)}"
        for key in set(content) & set(expected):
            assert_same(expected[key], content[key], f"{place}: {key}")
    elif isinstance(expected, list):
        assert len(expected) == len(content), place
        for k, (part, value) in enumerate(zip(expected, content, strict=True)):
            assert_same(part, value, f"{place}[{k}]")
    elif isinstance(expected, (str, bool)) or expected is None:
        assert content == expected, place
    else:
        assert content == pytest.approx(expected, abs=1e-9), place


def test_the_table_says_where_each_window_comes_from(written: Path, records: Records) -> None:
    table = pd.read_parquet(written / "predictions.parquet")
    assert not table.duplicated(["run", "windows", "at_s", "sample_id", "end_s"]).any() or (
        # Two of a record's drawn ends may coincide.
        set(table[table.duplicated(["run", "windows", "at_s", "sample_id", "end_s"])]["windows"]) == {"drawn"}
    )
    of_records = records.table.set_index("sample_id").loc[table["sample_id"]].reset_index()
    np.testing.assert_allclose(table["end_after_onset_s"], table["end_s"] - of_records["t_onset"], atol=1e-9)
    np.testing.assert_allclose(table["lead_s"], of_records["t_commit"] - table["end_s"], atol=1e-9)
    for column in ("origin", "label", "snr_db", "n_sites", "scenario", "seed"):
        assert (table[column].to_numpy() == of_records[column].to_numpy()).all(), column
    at_lead = table[table["windows"] == "at_lead"]
    np.testing.assert_allclose(at_lead["lead_s"], at_lead["at_s"], atol=0.0051)
    assert set(at_lead["at_s"]) == {0.25, 0.5, 1.0, 1.5}
    assert list(dict.fromkeys(table["name"])) == ["boosted trees, seed 0", "ASI-BIP", "boosted trees, seed 1"]


def test_the_same_evaluation_writes_the_same_predictions(
    records: Records, network_run: Run, trees_run: Run, tmp_path: Path
) -> None:
    for name in ("first", "second"):
        settings = EvaluateSettings(ends_per_record=1)
        evaluate_records(trees_run, records, MADE_OF, tmp_path / name, settings, [network_run])
    first, second = ((tmp_path / name / "predictions.parquet").read_bytes() for name in ("first", "second"))
    assert first == second
