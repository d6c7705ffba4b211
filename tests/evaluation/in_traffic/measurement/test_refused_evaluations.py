"""Evaluations that are refused, with a line that says why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.in_traffic.measurement import evaluation as of_traffic
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN
from tests.support.scripted import InlineEngine, ScriptedSource


def test_a_predictor_that_looks_at_the_uv_is_refused_without_one(
    records: Records, trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    settings = SMALL_RUN.model_copy(update={"model": "uv-alone"})
    uv_alone = train_records(records, MADE_OF, tmp_path / "run", settings)
    with pytest.raises(InputError, match="uv-alone looks at the UV's reports"):
        evaluate_traffic(trees_run, study, tmp_path / "out", InlineEngine(), source=source, alone=uv_alone)


def test_a_run_of_other_windows_cannot_be_compared(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    slow = replace(trees_run, card=trees_run.card.model_copy(update={"tv_rate_hz": 200.0}))
    with pytest.raises(InputError, match="takes windows of other rates or another length"):
        evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), against=[slow], source=source)


def test_seeds_of_the_training_are_refused(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    split = {**trees_run.card.split, "train": ["road-21"]}
    run = replace(trees_run, card=trees_run.card.model_copy(update={"split": split}))
    with pytest.raises(InputError, match="was trained on seed 21 of road"):
        evaluate_traffic(run, study, tmp_path, InlineEngine(), source=source)


def test_a_run_of_other_rates_says_what_does_not_fit(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path
) -> None:
    streams = study.live.streams.model_copy(update={"decision_s": 0.015})
    odd = study.model_copy(update={"live": study.live.model_copy(update={"streams": streams})})
    with pytest.raises(InputError, match="is not a whole number of samples at the run's 100 Hz"):
        evaluate_traffic(trees_run, odd, tmp_path, InlineEngine(), source=source)


@pytest.mark.slow
def test_an_evaluation_does_not_go_on_with_other_versions(
    trees_run: Run, study: LiveStudy, source: ScriptedSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source)
    monkeypatch.setattr(of_traffic, "versions", lambda names: dict.fromkeys(names, "99"))
    with pytest.raises(InputError, match=r"was begun with other versions of .*libsumo.*; choose a new folder"):
        evaluate_traffic(trees_run, study, tmp_path, InlineEngine(), source=source)
