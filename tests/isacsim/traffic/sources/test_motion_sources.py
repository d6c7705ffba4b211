"""Motion sources: found by name, sent to workers, and added with one line."""

import pickle
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings, checked
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES, SumoSource, motion_source
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.generation.cost_estimate import estimate
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.scripted import InlineEngine, ScriptedSource, small_study


def test_the_default_source_simulates_the_studys_traffic() -> None:
    traffic, maneuvers = TrafficSettings(run_in_s=3.0), ManeuverSettings(rest_s=5.0)
    source = motion_source(DatasetStudy(traffic=traffic, maneuvers=maneuvers))
    assert source == SumoSource(traffic, maneuvers)


def test_sources_pickle_and_equal_ones_hash_equally() -> None:
    """Workers keep what they loaded by source; each gets its own copy."""
    for name in MOTION_SOURCES:
        source = motion_source(DatasetStudy(source=name))
        copy = pickle.loads(pickle.dumps(source))
        assert copy == source
        assert hash(copy) == hash(source)


def test_simulated_time_and_steps_count_in_the_expected_cost() -> None:
    study = DatasetStudy(traffic=TrafficSettings(run_in_s=100.0, duration_s=200.0))
    cost_s = motion_source(study).expected_cpu_s()
    finer = DatasetStudy(traffic=TrafficSettings(run_in_s=100.0, duration_s=200.0, step_s=0.005))
    longer = DatasetStudy(traffic=TrafficSettings(run_in_s=100.0, duration_s=500.0))
    assert cost_s > 0
    assert motion_source(finer).expected_cpu_s() == pytest.approx(2 * cost_s)
    assert motion_source(longer).expected_cpu_s() == pytest.approx(2 * cost_s)


def test_an_unknown_source_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"study\.toml: source: unknown motion source 'summo': did you mean sumo\?"):
        checked(DatasetStudy, {"source": "summo"}, "study.toml")


def test_a_registered_source_is_all_that_a_study_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class ScriptedSettings(Settings):
        warnings: int = 0

    @dataclass(frozen=True)
    class Registered(ScriptedSource):
        folder: Path = tmp_path
        scripted: ScriptedSettings = field(default_factory=ScriptedSettings)
        sections: ClassVar = {"scripted": ScriptedSettings}

        def __post_init__(self) -> None:
            object.__setattr__(self, "warnings", self.scripted.warnings)

    monkeypatch.setitem(MOTION_SOURCES._items, "scripted", Registered)
    study = small_study(source="scripted", scripted={"warnings": 2}, seeds={"first": 1, "last": 2})
    dataset = generate(study, tmp_path / "data", InlineEngine())
    assert set(dataset.frame(["source"])["source"]) == {"scripted"}
    source = ScriptedSource(tmp_path, warnings=2)
    by_hand = generate(study, tmp_path / "by_hand", InlineEngine(), source=source)
    assert dataset.digest == by_hand.digest
    assert estimate(study).cpu_s < estimate(small_study(seeds={"first": 1, "last": 2})).cpu_s
