"""What a dataset will take: against one that was made, and in proportion."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.settings import checked
from isac_cosim.labeling.generation.cost_estimate import estimate, sensed_anew
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.studies.study import read_study
from tests.support.scripted import small_study

QUICK = {"windows": 1600, "min_per_class": 60, "per_class": 20, "following": 20}


def test_the_quick_study_as_it_was_measured() -> None:
    """Its dataset was made of 26 episodes of 120 s and holds 1574 samples."""
    quick = read_study(None).dataset
    cost = estimate(quick)
    assert cost.episodes == 26
    assert cost.samples == pytest.approx(1574, rel=0.1)


def test_longer_episodes_as_they_were_measured() -> None:
    """The quick study of version 0.2.0 was made of 13 episodes of 240 s and held 1654 samples in 95.6 MB."""
    cost = estimate(checked(DatasetStudy, {"seeds": {"first": 1, "last": 60}, "selection": QUICK}, "test"))
    assert cost.episodes == 13
    assert cost.samples == pytest.approx(1654, rel=0.1)
    assert cost.bytes == pytest.approx(95.6e6, rel=0.1)


def test_it_grows_with_the_work() -> None:
    """Seeds, scenarios and simulated time count; what the seeds cannot give is not promised."""
    one = estimate(small_study(seeds={"first": 1, "last": 4}))
    assert estimate(small_study(seeds={"first": 1, "last": 8})).cpu_s == pytest.approx(2 * one.cpu_s, rel=0.01)
    two = estimate(small_study(scenarios=["a", "b"], seeds={"first": 1, "last": 4}))
    assert (two.episodes, two.bytes) == (8, pytest.approx(2 * one.bytes, rel=0.01))
    short, shorter = (
        estimate(small_study(seeds={"first": 1, "last": 4}, traffic={"duration_s": duration_s}))
        for duration_s in (120.0, 60.0)
    )
    assert short.samples < one.samples
    assert shorter.samples == pytest.approx(short.samples / 2, abs=1)
    bound = estimate(small_study(seeds={"first": 1, "last": 4}, selection={"windows": 10**6}))
    assert bound.samples == one.samples


def test_sensing_anew_is_cheaper_than_making() -> None:
    generated = estimate(small_study())
    for sensor in ("isac", "radar", "truth"):
        anew = sensed_anew(small_study(), generated, sensor)
        assert (anew.episodes, anew.samples, anew.bytes) == (0, generated.samples, generated.bytes)
        assert anew.cpu_s < generated.cpu_s / 5


def test_a_dry_run_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cosim.main(["run", "--dry-run", "--json", "--jobs", "4"]) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out)
    assert (result["cells"], result["trainings"], result["episodes"], result["jobs"]) == (1, 2, 26, 4)
    assert result["seconds"] == pytest.approx(result["cpu_s"] / 4 + result["training_s"], abs=0.1)
    assert "1 cell, 2 trainings, 1 dataset: " in captured.err
    assert "1638 samples" in captured.err
    assert list(tmp_path.iterdir()) == []
