"""Advisories in SUMO: what a vehicle does of them, and that it does so without jumps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.evaluation.closed_loop.advising import Advisor
from isac_cosim.evaluation.closed_loop.policy import Advisory, Instruction
from isac_cosim.evaluation.closed_loop.settings import AdvisorySettings
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import UNCHECKED_SPEED_MODE
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record_stepwise
from tests.support.roads import straight_road, vehicle

TRAFFIC = TrafficSettings(
    run_in_s=2.0,
    duration_s=18.0,
    sway=SwaySettings(sd_m=(0.0, 0.0)),
    speed_wander=SpeedWanderSettings(sd_share=(0.0, 0.0)),
)
PROMPT = AdvisorySettings(network_delay_s=0.1, reaction_s=(0.5, 0.5))


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load(straight_road(tmp_path_factory.mktemp("alone") / "alone0", vehicle("uv", speed=28.8)))


def driven(
    scenario: Scenario, settings: AdvisorySettings, *advisories: Advisory, rates: dict[str, Any] | None = None
) -> tuple[Recording, Advisor]:
    """Drive the scenario and send advisories at their times."""
    maneuvers = ManeuverSettings.model_validate({**LEFT_ALONE, **(rates or {})})
    advisor = Advisor(settings, ("test",), TRAFFIC.step_s)
    moments, waiting = record_stepwise(scenario, 1, TRAFFIC, maneuvers), list(advisories)
    while True:
        try:
            moment = next(moments)
        except StopIteration as stop:
            return stop.value, advisor
        while waiting and waiting[0].time_s <= moment.time_s + 1e-9:
            advisor.send(waiting.pop(0))
        advisor.step(moment)


@pytest.mark.parametrize(("instruction", "drop_mps", "peak_mps2"), [("open_gap", 2.0, 1.0), ("slow", 4.0, 2.0)])
def test_a_vehicle_slows_holds_and_goes_on_without_a_jump(
    alone: Scenario, instruction: Instruction, drop_mps: float, peak_mps2: float
) -> None:
    recording, advisor = driven(alone, PROMPT, Advisory("uv", instruction, 4.0))
    track = recording.tracks["uv"]
    time, speed = recording.times(track), np.asarray(track.speed)
    start = speed[0]
    acceleration = np.diff(speed) / TRAFFIC.step_s
    # Nothing happens before delay and reaction; then the speed falls by the drop, and comes back.
    assert np.abs(acceleration[time[1:] < 4.6]).max() < 0.1
    assert speed.min() == pytest.approx(start - drop_mps, abs=0.1)
    assert speed[-1] > start - 0.5
    assert acceleration.min() == pytest.approx(-peak_mps2, abs=0.1)
    assert acceleration.max() < 2.1
    # SUMO's drivers decide ten times a second, so the jerk is judged over such an interval.
    assert np.abs(acceleration[10:] - acceleration[:-10]).max() < 0.5
    assert [sent.fate for sent in advisor.sent] == ["followed"]


@pytest.mark.parametrize("leader_brakes_s", [1.4, 4.5])
def test_a_vehicle_that_slows_on_advice_still_brakes_as_hard_as_it_can(tmp_path: Path, leader_brakes_s: float) -> None:
    """With a speed set, SUMO lets it brake comfortably only, or, without that check, stop within a step."""
    pair = vehicle("tv", position=60.0, speed=28.0) + vehicle("uv", position=10.0, speed=28.0)
    scenario = load(straight_road(tmp_path / "pair0", pair))
    advisor = Advisor(PROMPT, ("test",), TRAFFIC.step_s)
    moments = record_stepwise(scenario, 1, TRAFFIC, ManeuverSettings.model_validate(LEFT_ALONE))
    advisor.send(Advisory("uv", "slow", 3.0))
    while True:
        try:
            moment = next(moments)
        except StopIteration as stop:
            recording: Recording = stop.value
            break
        if moment.time_s > leader_brakes_s and "tv" in moment.sumo.vehicle.getIDList():
            moment.sumo.vehicle.setSpeedMode("tv", UNCHECKED_SPEED_MODE)
            speed = moment.sumo.vehicle.getSpeed("tv")
            moment.sumo.vehicle.setSpeed("tv", max(speed - 9.0 * TRAFFIC.step_s, 0.0))
        advisor.step(moment)
    assert recording.incidents.collided == ()
    assert [sent.fate for sent in advisor.sent] == ["dropped"]
    assert -9.01 < (np.diff(recording.tracks["uv"].speed) / TRAFFIC.step_s).min() < -5.0


def test_a_lane_is_held(tmp_path: Path) -> None:
    slow = '<vType id="truck" carFollowModel="IDM" maxSpeed="15" length="10" speedDev="0"/>'
    ahead = '<vehicle id="ahead" type="truck" route="all" depart="0" departLane="0" departPos="100" departSpeed="15"/>'
    eager = '<vType id="eager" carFollowModel="IDM" lcSpeedGain="5" speedFactor="0.8" speedDev="0"/>'
    uv = '<vehicle id="uv" type="eager" route="all" depart="0" departLane="0" departPos="20" departSpeed="15"/>'
    scenario = load(straight_road(tmp_path, slow + eager + ahead + uv, lanes=2))
    free, _ = driven(scenario, PROMPT)
    changed_s = free.times(free.tracks["uv"])[np.flatnonzero(np.diff(free.tracks["uv"].lane))[0]]
    settings = PROMPT.model_copy(update={"hold_lane_s": 30.0, "reaction_s": (0.0, 0.0), "network_delay_s": 0.0})
    held, _ = driven(scenario, settings, Advisory("uv", "hold_lane", 0.5))
    assert changed_s < 15.0
    assert (np.diff(held.tracks["uv"].lane) == 0).all()


def test_drivers_refuse_rest_and_have_one_advisory_at_a_time(alone: Scenario) -> None:
    deaf = PROMPT.model_copy(update={"compliance": 0.0})
    _, advisor = driven(alone, deaf, Advisory("uv", "slow", 4.0))
    assert [sent.fate for sent in advisor.sent] == ["refused"]
    again = [Advisory("uv", "open_gap", 4.0), Advisory("uv", "slow", 6.0), Advisory("nobody", "slow", 6.0)]
    _, advisor = driven(alone, PROMPT, *again)
    assert [sent.fate for sent in advisor.sent] == ["followed", "busy", "gone"]


def test_a_driver_who_brakes_for_itself_drops_the_advisory_and_the_brake_is_as_hard(alone: Scenario) -> None:
    rates = {"hard_brake_per_vehicle_hour": 3600.0, "hard_brake": {"rise_s": (0.0, 0.0)}}
    settings = PROMPT.model_copy(update={"reaction_s": (0.0, 0.0), "network_delay_s": 0.0, "hold_s": 10.0})
    free, _ = driven(alone, PROMPT, rates=rates)
    braking = min(command.start for command in free.commands if command.start > 4.0)
    advised, advisor = driven(alone, settings, Advisory("uv", "open_gap", round(braking - 1.0, 2)), rates=rates)
    assert [sent.fate for sent in advisor.sent] == ["dropped"]
    for recording in (free, advised):
        track = recording.tracks["uv"]
        hardest = np.diff(np.asarray(track.speed)).min() / TRAFFIC.step_s
        assert hardest < -4.0
