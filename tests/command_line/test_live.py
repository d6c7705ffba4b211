"""`evaluate --traffic`: what it is given, and what it shows."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

import cosim
from command_line import live
from command_line.live import LiveArguments, evaluate_and_show, source_of
from isacsim.errors import InputError
from models.live import evaluation
from models.live.settings import LiveStudy
from models.run import Run
from models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records
from tests.support.scripted import InlineEngine, ScriptedSource

NOTHING = LiveArguments(None, None, None, None)


def test_a_run_is_evaluated_on_a_dataset_or_in_traffic() -> None:
    assert source_of(Path("data"), None, NOTHING) == "data"
    assert source_of(None, "motorway", NOTHING) == "traffic"
    with pytest.raises(InputError, match="give one of them"):
        source_of(None, None, NOTHING)
    with pytest.raises(InputError, match="--duration applies to an evaluation in traffic"):
        source_of(Path("data"), None, LiveArguments(None, None, 30.0, None))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    settings = SMALL_RUN.model_copy(update={"model": "trees"})
    return train_records(make_records(4, 2), MADE_OF, tmp_path_factory.mktemp("run") / "trees", settings)


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Traffic from formulas, of which one seed has none, in this process."""
    source = ScriptedSource(tmp_path, empty=(2002, 2003, 2004, 1002))
    monkeypatch.setattr(evaluation, "motion_source", lambda study: source)
    monkeypatch.setattr("labeling.generation.engine.LocalEngine", lambda jobs: InlineEngine())


@pytest.mark.usefixtures("scripted")
def test_the_command_measures_draws_and_prints(run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "live"
    words = ["evaluate", str(run.path), "--traffic", "road", "--seeds", "1001:1002", "-o", str(out), "--json"]
    assert cosim.main(words) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out.splitlines()[-1])
    assert {"vehicle_hours", "recall_at", "natural", "commanded", "baselines", "real_time_factor"} <= set(result)
    assert result["made_by"]["seeds"] == ["road-1001", "road-1002"]
    assert "vehicle-hours" in captured.err
    assert "rule of the road" in captured.err
    names = {path.name for path in out.iterdir()}
    assert {"metrics.json", "speed.json", "recall_against_false_alarms.png", "time_line.png"} <= names


def test_ranges_are_checked_before_anything_runs(run: Run, tmp_path: Path) -> None:
    console = Console(file=io.StringIO())
    for arguments, message in (
        (LiveArguments("5", None, None, None), "--seeds 5: is not a range"),
        (LiveArguments(None, "9:1", None, None), "--development 9:1: is not a range"),
        (LiveArguments("1:9", "5:6", None, None), "overlap"),
    ):
        with pytest.raises(InputError, match=message):
            evaluate_and_show(run.path, "motorway", arguments, tmp_path / "new", (), console)
    assert not (tmp_path / "new").exists()


def test_the_study_of_the_command_is_that_of_the_arguments(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    studies: list[LiveStudy] = []

    def stop(loaded: Run, study: LiveStudy, *rest: object) -> None:
        studies.append(study)
        raise InputError("stop")

    monkeypatch.setattr(evaluation, "evaluate_traffic", stop)
    with pytest.raises(InputError, match="stop"):
        live.evaluate_and_show(run.path, "motorway", LiveArguments("3:4", "5:6", 20.0, 1), None, (), Console())
    (study,) = studies
    assert study.seeds == [5, 6, 3, 4]
    assert study.dataset.traffic.duration_s == 20.0
