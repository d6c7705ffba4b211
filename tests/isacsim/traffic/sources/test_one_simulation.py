"""One simulation a process: a second one is refused, and what other code does with libsumo is noticed."""

from __future__ import annotations

import gc
import os
import warnings
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.one_simulation import TrafficError, simulation_runs
from isac_cosim.isacsim.traffic.sources.sumo import Moment, TrafficSettings, record, record_stepwise, session
from tests.support.roads import straight_road, vehicle

ALONE = ManeuverSettings(**LEFT_ALONE)
EVERY_STEP = TrafficSettings(run_in_s=1.0, duration_s=2.0)
SAMPLED = EVERY_STEP.model_copy(update={"sample_s": 0.1})


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load(straight_road(tmp_path_factory.mktemp("road") / "road", vehicle("a")))


Stepwise = Generator[Moment, None, Recording]


def begun(scenario: Scenario, traffic: TrafficSettings = EVERY_STEP, steps: int = 150) -> Stepwise:
    moments = record_stepwise(scenario, 1, traffic, ALONE)
    for _ in range(steps):
        next(moments)
    return moments


def finished(moments: Stepwise) -> Recording:
    while True:
        try:
            next(moments)
        except StopIteration as stop:
            recording: Recording = stop.value
            return recording


SECOND: dict[str, Callable[[Scenario], object]] = {
    "record": lambda scenario: record(scenario, 2, EVERY_STEP, ALONE),
    "stepwise": lambda scenario: next(record_stepwise(scenario, 2, EVERY_STEP, ALONE)),
    "session": lambda scenario: session(scenario, 2, EVERY_STEP).__enter__(),
}


@pytest.mark.parametrize("way", SECOND)
def test_a_second_simulation_is_refused_and_the_first_goes_on(scenario: Scenario, way: str) -> None:
    alone = record(scenario, 1, EVERY_STEP, ALONE)
    first = begun(scenario)
    with pytest.raises(InputError, match=r"scenario road: another simulation is open in this process") as caught:
        SECOND[way](scenario)
    assert "\n" not in str(caught.value)
    assert finished(first).tracks["a"].x.tolist() == alone.tracks["a"].x.tolist()
    assert not simulation_runs()


def test_the_users_own_simulation_is_not_replaced(scenario: Scenario) -> None:
    import libsumo

    libsumo.start(["sumo", "-n", str(scenario.network), "--no-step-log"])
    try:
        libsumo.simulationStep()
        with pytest.raises(InputError, match="another simulation is open in this process"):
            record(scenario, 1, EVERY_STEP, ALONE)
        assert libsumo.simulation.getTime() == 1.0
    finally:
        libsumo.close()


def start(libsumo: Any, network: str) -> None:
    libsumo.start(["sumo", "-n", network, "--no-step-log"])


OTHERS: dict[str, Callable[[Any, str], object]] = {
    "start": start,
    "step": lambda libsumo, _: libsumo.simulationStep(),
    "close": lambda libsumo, _: libsumo.close(),
    "close and start": lambda libsumo, network: (libsumo.close(), start(libsumo, network)),
}


@pytest.mark.parametrize("way", OTHERS)
def test_a_simulation_that_other_code_takes_away_is_an_error_and_theirs_stays(scenario: Scenario, way: str) -> None:
    import libsumo

    first = begun(scenario)
    OTHERS[way](libsumo, str(scenario.network))
    theirs = "start" in way
    try:
        with pytest.raises(TrafficError, match="other code in this process has used libsumo") as caught:
            next(first)
        assert "\n" not in str(caught.value)
        assert libsumo.simulation.isLoaded() == theirs
    finally:
        if theirs:
            libsumo.close()
    record(scenario, 1, EVERY_STEP, ALONE)


def test_a_refused_scenario_leaves_nothing_open(tmp_path: Path) -> None:
    lost = load(straight_road(tmp_path / "road", vehicle("a").replace('route="all"', 'route="nowhere"')))
    with pytest.raises(InputError, match="SUMO refuses scenario"):
        record(lost, 1, EVERY_STEP, ALONE)
    assert not simulation_runs()


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the system does not list what is open there")
@pytest.mark.parametrize("traffic", [EVERY_STEP, SAMPLED], ids=["every step", "sampled"])
@pytest.mark.parametrize("whole", [True, False], ids=["to its end", "and stops"])
def test_a_recording_closes_its_files(scenario: Scenario, traffic: TrafficSettings, whole: bool) -> None:
    record(scenario, 1, traffic, ALONE)  # imports what it needs
    gc.collect()
    before = sorted(os.listdir("/proc/self/fd"))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        if whole:
            kept = record(scenario, 1, traffic, ALONE)
            assert len(kept.tracks["a"]) == 200
            del kept
        else:
            begun(scenario, traffic).close()
        assert sorted(os.listdir("/proc/self/fd")) == before
    assert [str(warning.message) for warning in heard if issubclass(warning.category, ResourceWarning)] == []
