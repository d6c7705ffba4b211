"""The benches of training and inference, made small: what they report, not how fast."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

import isac_cosim.benchmarks.infer
import isac_cosim.benchmarks.train
from isac_cosim.benchmarks import environment

SMALL = {"hidden": 4, "width": 8, "heads": 2, "feedforward": 8}


def test_train_extrapolates_epochs_of_every_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.train, "BATCH", 2)
    monkeypatch.setattr(isac_cosim.benchmarks.train, "EPOCH", 20)
    networks = isac_cosim.benchmarks.train.NETWORKS
    assert networks["literal"].tokens == networks["literal_pytorch"].tokens == "literal"
    assert networks["literal"].attention_dropout == 0.0
    assert networks["literal_pytorch"].attention_dropout == networks["literal_pytorch"].dropout == 0.1
    compared = ("alone", "beside_two_busy_processes", "threads", "pages")
    seconds: dict[str, Any] = {name: {"ratio": 0.8} for name in compared}
    seconds["slower_beside_others"] = 1.8
    monkeypatch.setattr(isac_cosim.benchmarks.train.environment, "run", lambda: seconds)
    small = {name: network.model_copy(update=SMALL) for name, network in networks.items()}
    monkeypatch.setattr(isac_cosim.benchmarks.train, "NETWORKS", small)
    result = isac_cosim.benchmarks.train.run()
    assert set(result["epoch_s"]) == set(result["step_s"]) == set(networks)
    for name in networks:
        assert result["epoch_s"][name] == pytest.approx(10 * result["step_s"][name], abs=0.06)
    assert all(ratio.of(result) > 0 for ratio in isac_cosim.benchmarks.train.RATIOS)
    assert result["environment"] == seconds


@pytest.mark.slow
def test_environment_compares_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    step = environment.measured_step({"OMP_NUM_THREADS": "1"}, steps=1)
    assert min(step.elapsed_s, step.cpu_s, step.page_faults) > 0

    def scripted(variables: Mapping[str, str], busy: int = 0) -> environment.Step:
        passive, two = variables.get("OMP_WAIT_POLICY") == "passive", variables["OMP_NUM_THREADS"] == "2"
        huge = variables.get("THP_MEM_ALLOC_ENABLE") == "1"
        return environment.Step(1 + 0.5 * passive + busy - 0.25 * two, 1 - 0.5 * huge, 100 - 90 * huge)

    monkeypatch.setattr(environment, "measured_step", scripted)
    result = environment.run()
    assert result["alone"] == {"active_s": 0.75, "passive_s": 1.25, "ratio": 1.67}
    assert result["slower_beside_others"] == 2.6
    assert result["threads"]["ratio"] == 0.75
    assert result["pages"]["ratio"] == 0.5
    assert result["pages"]["page_faults"] == {"small_pages": 100, "huge_pages": 10}


def test_infer_times_every_network(monkeypatch: pytest.MonkeyPatch) -> None:
    small = dict(list(isac_cosim.benchmarks.infer.predictors().items())[2:])
    monkeypatch.setattr(isac_cosim.benchmarks.infer, "ROUNDS", 1)
    monkeypatch.setattr(isac_cosim.benchmarks.infer, "BATCH", 2)
    stood_in = {"asi-bip": small["aligned"], "asi-bip literal": small["aligned"], **small}
    monkeypatch.setattr(isac_cosim.benchmarks.infer, "predictors", lambda: stood_in)
    result = isac_cosim.benchmarks.infer.run()
    assert set(result["window_ms"]) == set(result["window_ms_of_a_batch"]) == set(stood_in)
    assert all(value > 0 for value in result["window_ms"].values())
    assert [ratio.of(result) > 0 for ratio in isac_cosim.benchmarks.infer.RATIOS] == [True]
    assert result["parameters"]["castformer"] == small["castformer"].network.parameter_count
