"""The Gymnasium environment: Gymnasium's own checker, repeatability, and several processes at once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.closed_loop.environment import ENVIRONMENT, FEATURES, AdvisoryEnv, register


@pytest.fixture(scope="module")
def settings(road: Path) -> dict[str, Any]:
    prompt = {"advisories": {"network_delay_s": 0.0, "reaction_s": (0.0, 0.0)}}
    return {
        "scenario": str(road),
        "duration_s": 9.0,
        "run_in_s": 1.0,
        "slots": 3,
        "natural": True,
        "sensor": "truth",
        "settings": prompt,
    }


@pytest.fixture
def environment(settings: dict[str, Any]) -> Iterator[AdvisoryEnv]:
    register()
    wrapped = gymnasium.make(ENVIRONMENT, **settings)
    assert isinstance(wrapped.unwrapped, AdvisoryEnv)
    yield wrapped.unwrapped
    wrapped.close()


@pytest.mark.filterwarnings("ignore:.*Box.*infinity")
def test_gymnasiums_checker_passes(environment: AdvisoryEnv) -> None:
    check_env(environment, skip_render_check=True)


def played(environment: AdvisoryEnv, action: int) -> tuple[list[np.ndarray], list[float]]:
    observation, _ = environment.reset(seed=5)
    observations, rewards, truncated = [observation], [], False
    while not truncated:
        observation, reward, terminated, truncated, info = environment.step(np.full(3, action))
        assert not terminated
        observations.append(observation)
        rewards.append(reward)
        assert info["advisories"] <= 3
    return observations, rewards


def test_an_episode_is_repeatable_and_an_advisory_changes_it(environment: AdvisoryEnv) -> None:
    first, rewards = played(environment, 0)
    again, _ = played(environment, 0)
    slowed, with_cost = played(environment, 2)
    assert 3 <= len(first) <= 8
    np.testing.assert_array_equal(np.stack(first), np.stack(again))
    # v2 follows v1, which is a TV because it follows v0; v0 has no UV ahead, so nobody senses it for v1.
    assert first[0][:, FEATURES.index("present")].tolist() == [1.0, 0.0, 0.0]
    speed = FEATURES.index("speed")
    assert slowed[-2][0, speed] < first[-2][0, speed] - 1.0
    assert min(with_cost) < min(rewards)


def test_one_environment_a_process(environment: AdvisoryEnv, settings: dict[str, Any]) -> None:
    environment.reset(seed=1)
    second = AdvisoryEnv(**settings)
    with pytest.raises(InputError, match="already running in this process"):
        second.reset(seed=1)
    environment.close()
    second.reset(seed=1)
    second.close()


def test_a_time_between_actions_below_the_networks_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"give a multiple of the 0\.1 s between two decisions"):
        AdvisoryEnv(**settings, every_s=0.01)


@pytest.mark.slow
def test_several_run_as_processes(settings: dict[str, Any]) -> None:
    register()
    vector = AsyncVectorEnv([lambda: AdvisoryEnv(**settings)] * 2, context="spawn")
    try:
        observations, info = vector.reset(seed=[5, 6])
        assert observations.shape == (2, 3, len(FEATURES))
        assert len(set(info["traffic_seed"].tolist())) == 2
        observations, rewards, *_ = vector.step(np.zeros((2, 3), np.int64))
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()
    finally:
        vector.close()
