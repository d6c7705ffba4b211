"""What a predictor's modules do along a record: the numbers of its windows, and nothing of other predictors."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.evaluation.on_windows.explained import inspect_windows
from isac_cosim.evaluation.report.replay.content import Inside
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.labeling.dataset.finding import find_episode, of_one
from isac_cosim.models.data.windows import Ends, Records
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.evaluation.on_windows.test_explained import TINY
from tests.evaluation.report.replay.test_making import HereEngine
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.made_up_dataset import write_dataset


def test_the_lines_are_those_of_the_windows_that_are_answered(records: Records, tmp_path: Path) -> None:
    settings = type(SMALL_RUN).model_validate({**SMALL_RUN.model_dump(), "model": "castformer", "castformer": TINY})
    run = train_records(records, MADE_OF, tmp_path / "run", settings)
    dataset = write_dataset(tmp_path / "data")
    shard = find_episode(dataset, "toy-1")
    shown = replay_of(dataset, shard, HereEngine(), run)
    assert shown.modules == 4
    assert any("no proof" in remark for remark in shown.remarks)
    own, answers = Records.of(of_one(dataset, shard)), shown.records[2].answers
    assert answers is not None
    steps = np.rint((answers.from_s + answers.step_s * np.arange(len(answers.probabilities))) * own.uv_rate_hz)
    seen = inspect_windows(run, own, Ends(np.full(len(steps), 2), steps.astype(np.int64)))
    age, gate, residual, weight = answers.inside
    np.testing.assert_allclose(gate.values.T, seen.gate, rtol=1e-6)
    np.testing.assert_allclose(residual.values.T, seen.residual, rtol=1e-6)
    np.testing.assert_allclose(weight.values.sum(axis=0), np.ones(len(steps)), rtol=1e-5)
    assert seen.attention is not None
    mean = 0.1 * (seen.attention * np.arange(seen.attention.shape[2])).sum(2) / seen.attention.sum(2)
    np.testing.assert_allclose(age.values.T, mean, rtol=1e-6)


def test_other_predictors_show_nothing_of_their_inside(trees_run: Run, tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path / "data")
    shown = replay_of(dataset, find_episode(dataset, "toy-1"), HereEngine(), trees_run)
    assert shown.modules == 0


def test_packed_lines_fit_their_axis() -> None:
    content = Inside("CPE: residual", ("in", "out"), np.array([[0.0, 2.5], [1.0, 0.2]])).packed()
    assert content["top"] == 3.0
    lines = [np.frombuffer(base64.b64decode(line), np.uint8) for line in content["lines"]]
    assert 3.0 * np.array(lines) / 255 == pytest.approx(np.array([[0.0, 2.5], [1.0, 0.2]]), abs=0.006)
