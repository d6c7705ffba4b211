"""Arms of one seed in SUMO: which traffic they share, and what they know."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.closed_loop.episode import Alarming, run_arm
from isac_cosim.evaluation.closed_loop.loop import ClosedLoop
from isac_cosim.evaluation.closed_loop.settings import AdvisorySettings, Arm, ClosedLoopSettings
from isac_cosim.evaluation.closed_loop.store import ArmEpisode
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic import motion
from isac_cosim.models.inference import Infer

PROMPT = ClosedLoopSettings(advisories=AdvisorySettings(network_delay_s=0.0, reaction_s=(0.0, 0.0)))


@pytest.fixture(scope="module")
def episodes(study: LiveStudy, scenario: Scenario, infer: Infer, alarming: Alarming) -> dict[Arm, ArmEpisode]:
    arms: tuple[Arm, ...] = ("none", "placebo", "isac", "random", "radar")
    return {arm: run_arm(study, PROMPT, scenario, 1, arm, infer, alarming) for arm in arms}


def test_sensing_without_sending_leaves_the_traffic_as_it_is_to_the_last_bit(
    episodes: dict[Arm, ArmEpisode],
) -> None:
    assert episodes["placebo"].facts.alarms
    assert not episodes["placebo"].facts.advisories
    assert episodes["placebo"].facts.traffic == episodes["none"].facts.traffic


@pytest.mark.parametrize("arm", ["isac", "random", "radar"])
def test_traffic_is_the_same_until_the_first_advisory_and_another_after(
    episodes: dict[Arm, ArmEpisode], arm: Arm
) -> None:
    none, advised = episodes["none"], episodes[arm]
    first_s = min(advisory.time_s for advisory in advised.facts.advisories)
    for name in ("x", "y", "speed"):
        before, after = (
            {
                (episode.driving.names[vehicle], round(time, 3)): value
                for vehicle, time, value in zip(
                    episode.driving.vehicle.tolist(),
                    episode.driving.time_s.tolist(),
                    getattr(episode.driving, name).tolist(),
                    strict=True,
                )
                if time <= first_s
            }
            for episode in (none, advised)
        )
        assert before
        assert before == after
    assert none.facts.traffic != advised.facts.traffic


def test_alarms_of_the_placebo_arm_are_those_of_isac_until_the_first_advisory(
    episodes: dict[Arm, ArmEpisode],
) -> None:
    first_s = min(advisory.time_s for advisory in episodes["isac"].facts.advisories)
    alarms = [
        [alarm for alarm in episodes[arm].facts.alarms if alarm.raised_s <= first_s] for arm in ("isac", "placebo")
    ]
    assert alarms[0] == alarms[1] != []


@pytest.mark.parametrize(
    ("arm", "within_m"), [("truth", 0.02), ("isac", 0.5), pytest.param("radar", 3.0, marks=pytest.mark.slow)]
)
def test_the_network_sees_the_recordings_motion_trailing_by_the_kernel(
    study: LiveStudy, scenario: Scenario, infer: Infer, arm: Arm, within_m: float
) -> None:
    settings = ClosedLoopSettings()
    loop = ClosedLoop.of(scenario, 1, study, settings, infer.run.card.shape, arm, None)
    decisions, known = loop.decisions(), []
    while True:
        try:
            decision = next(decisions)
        except StopIteration as stop:
            recording = stop.value
            break
        knowledge = decision.knowledge
        assert decision.moment.time_s - knowledge.time_s == pytest.approx(0.6)
        known += [(knowledge.time_s, tv, window) for tv, window in zip(knowledge.tv, knowledge.windows[0], strict=True)]
    assert len(known) > 20
    for time_s, tv, window in known[::10]:
        times = time_s + (np.arange(-window.shape[1], 0) + 1) / infer.run.card.tv_rate_hz
        truth = motion.states(recording, recording.tracks[tv], times, study.dataset.motion)
        assert np.hypot(*(window[:2] - truth[:2])).max() < within_m


def test_the_causal_kernel_knows_at_once(study: LiveStudy, scenario: Scenario, infer: Infer) -> None:
    settings = ClosedLoopSettings(conditioning="causal")
    loop = ClosedLoop.of(scenario, 1, study, settings, infer.run.card.shape, "truth", None)
    decisions = loop.decisions()
    decision = next(decisions)
    decisions.close()
    assert decision.knowledge.time_s == pytest.approx(decision.moment.time_s)
