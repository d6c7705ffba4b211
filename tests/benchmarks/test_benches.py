"""The benches of traffic and generation, made short: what they report, not how fast."""

from __future__ import annotations

import json
from functools import partial

import pytest

import cosim
import isac_cosim.benchmarks.generate
import isac_cosim.benchmarks.scene
import isac_cosim.benchmarks.traffic
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.generation.settings import DatasetStudy

SHORT = TrafficSettings(run_in_s=15.0, duration_s=10.0)


def reported(what: str, capfd: pytest.CaptureFixture[str]) -> dict[str, object]:
    assert cosim.main(["bench", what, "--json", "--quiet"]) == 0
    captured = capfd.readouterr()
    assert captured.err == ""
    result = json.loads(captured.out)
    assert isinstance(result, dict)
    return result


@pytest.mark.slow
def test_traffic_compares_recording_with_bare_stepping(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.traffic, "TrafficSettings", lambda **_: SHORT)
    monkeypatch.setattr(isac_cosim.benchmarks.traffic, "ROUNDS", 1)
    result = reported("traffic", capfd)
    assert {
        "ratio",
        "ratio_of",
        "ratio_sampled",
        "ratio_with_maneuvers",
        "simulated_s_per_cpu_s",
        "vehicles",
    } <= set(result)
    kinds = {"bare", "recording", "recording_sampled", "recording_and_maneuvers"}
    assert set(result["simulated_s_per_cpu_s"]) == kinds  # type: ignore[call-overload]
    assert result["vehicles"] > 5  # type: ignore[operator]


@pytest.mark.slow
def test_generate_adds_its_stages_up(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    long_enough = TrafficSettings(run_in_s=45.0, duration_s=40.0)
    monkeypatch.setattr(isac_cosim.benchmarks.generate, "DatasetStudy", partial(DatasetStudy, traffic=long_enough))
    monkeypatch.setattr(isac_cosim.benchmarks.generate, "record_s", lambda records: 0.5 / records)
    scaled = {"ratio": 1.8, "ratio_of": "two workers over one", "spread": 0.1}
    monkeypatch.setattr(isac_cosim.benchmarks.generate.scaling, "run", lambda: dict(scaled))
    result = reported("generate", capfd)
    stages: dict[str, float] = result["stages_s"]  # type: ignore[assignment]
    assert list(stages) == ["traffic", "labels", "candidates", "motion_and_sensing", "writing"]
    assert result["episode_s"] == pytest.approx(sum(stages.values()), abs=0.01)
    assert result["traffic_over_episode"] == pytest.approx(stages["traffic"] / sum(stages.values()), abs=0.01)
    assert (result["ratio"], result["ratio_of"]) == (1.8, "two workers over one")
    assert result["scaling"] == {"spread": 0.1}
    assert result["record_s"] == {"alone": 0.5, "of_32": 0.0156}
    assert result["samples"] > 0  # type: ignore[operator]


def test_a_scene_is_compared_with_its_oracle(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.scene, "ROUNDS", 1)
    result = reported("scene", capfd)
    panel_ms: dict[str, float] = result["panel_ms"]  # type: ignore[assignment]
    assert result["ratio"] == pytest.approx(panel_ms["oracle"] / (panel_ms["draw"] + panel_ms["detect"]), rel=0.01)
    assert result["settings"] == {"points": 60, "cells": 40 * 232 * 16, "rounds": 1}
