"""A study of streams: one file from traffic to a live evaluation."""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.studies.study import Study, read_study

SMALL = """
[dataset]
streams = true
scenarios = ["straight_road"]
seeds = { first = 1, last = 3 }
[dataset.traffic]
duration_s = 45.0
[dataset.sensing.channel]
kind = "link"
[training.streams]
least_events = 1
trees = { rounds = 5, least_leaf = 2 }
[live]
seeds = { first = 1001, last = 1001 }
development = { first = 2001, last = 2001 }
stress = true
truth = true
"""


@pytest.mark.slow
def test_one_command_generates_trains_and_evaluates_live(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "small.toml", tmp_path / "out"
    file.write_text(SMALL)
    command = ["run", str(file), "-o", str(out), "--jobs", "1", "--json"]
    assert cosim.main(command) == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert printed["run"] == str(out / "run")
    result = json.loads((out / "live" / "metrics.json").read_text())
    assert result["model"] == "trees"
    assert list(result["methods"]) == ["hazard"]
    assert "situation trees" in result["baselines"]
    assert result["stress"]["vehicle_hours"] > 0
    assert result["truth"]["lost"]
    stressed = json.loads((out / "live" / "stress" / "metrics.json").read_text())
    assert "situation trees" in stressed["baselines"]
    assert (out / "live" / "index.html").is_file()
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet") if path.parent.name != "roads"}
    assert cosim.main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet") if path.parent.name != "roads"} == before


def test_the_bundled_study_says_what_it_costs(capsys: pytest.CaptureFixture[str]) -> None:
    file = Path(str(importlib.resources.files("isac_cosim.studies") / "live.toml"))
    study = read_study(file)
    assert study.streams
    assert study.live.stress
    assert study.training.model == "causal"
    assert study.stream_floor is not None
    assert study.stream_floor.model == "situation"
    assert cosim.main(["run", str(file), "--dry-run"]) == 0
    assert "14 episodes of streams" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"dataset": {"streams": True, "scenarios": ["motorway", "city"]}}, "give one"),
        ({"dataset": {"streams": True}, "sweep": {"models": ["trees"]}}, "records are swept"),
        ({"dataset": {"streams": True}, "training": {"model": "rule"}}, "is not trained on streams"),
        ({"dataset": {"streams": "perhaps"}}, "streams"),
        ({"training": {"model": "trees", "streams": {}}}, r"dataset\.streams = true"),
    ],
)
def test_what_does_not_go_with_streams_is_refused(content: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Study.model_validate(content)


def test_what_is_written_is_read_again() -> None:
    study = Study.model_validate({"dataset": {"streams": True, "scenarios": ["motorway"]}})
    assert study.training.model == "trees"
    assert Study.model_validate(study.model_dump(mode="json")) == study
    assert study.model_copy(update={"training": study.stream_floor}).stream_floor is None
