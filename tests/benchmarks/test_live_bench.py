"""The bench of live watching, made short: what it reports, not how fast."""

from __future__ import annotations

import pytest

import isac_cosim.benchmarks.live
from isac_cosim import benchmarks
from isac_cosim.models.predictors.trees import TreesSettings


def test_it_says_how_much_faster_than_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.live, "VEHICLES", 2)
    monkeypatch.setattr(isac_cosim.benchmarks.live, "DURATION_S", 6.0)
    monkeypatch.setattr(isac_cosim.benchmarks.live, "TreesSettings", lambda: TreesSettings(rounds=5))
    monkeypatch.setattr(isac_cosim.benchmarks.live, "ROUNDS", 1)
    result = benchmarks.run("live")
    assert result["real_time_factor"] > 0
    assert result["real_time_factor_causal"] > 0
    assert 2 <= result["panels"] <= 4
    parts = {"sensing_and_tracking", "cutting_windows", "boosted_trees", "causal_network", "rule"}
    assert set(result["ms_per_vehicle_second"]) == parts
    assert all(milliseconds > 0 for milliseconds in result["ms_per_vehicle_second"].values())
