"""The Gymnasium environment: Gymnasium's own checker, repeatability, and other simulations beside it."""

from __future__ import annotations

import gc
import glob
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import cosim
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.evaluation.closed_loop.environment.advisory_env import AdvisoryEnv
from isac_cosim.evaluation.closed_loop.environment.observation import FEATURES
from isac_cosim.gym import ENVIRONMENT
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

ROOT = Path(cosim.__file__).parent
WAIT = [0, 0, 0]


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
    wrapped = gymnasium.make(ENVIRONMENT, **settings)
    assert isinstance(wrapped.unwrapped, AdvisoryEnv)
    yield wrapped.unwrapped
    wrapped.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("error::UserWarning")
def test_gymnasiums_checker_passes_without_a_warning(environment: AdvisoryEnv) -> None:
    """It renders a second environment while the first is open."""
    check_env(environment)


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


@pytest.mark.slow
def test_a_second_environment_is_the_same_in_a_process_of_its_own(
    environment: AdvisoryEnv, settings: dict[str, Any]
) -> None:
    """As where an agent is evaluated while it learns."""
    played_here, _ = played(environment, 2)
    environment.reset(seed=1)
    others = set(psutil.Process().children())
    with gymnasium.make(ENVIRONMENT, render_mode="rgb_array", **settings) as second:
        assert isinstance(second.unwrapped, AdvisoryEnv)
        played_there, _ = played(second.unwrapped, 2)
        (process,) = set(psutil.Process().children()) - others
        frame = second.unwrapped.render()
        assert isinstance(frame, np.ndarray)
        assert frame.shape == (540, 960, 3)
        environment.step(np.array(WAIT))
    np.testing.assert_array_equal(np.stack(played_there), np.stack(played_here))
    assert not process.is_running()


@pytest.mark.slow
def test_a_process_that_dies_ends_the_episode_and_not_the_environment(
    environment: AdvisoryEnv, settings: dict[str, Any]
) -> None:
    environment.reset(seed=1)
    others = set(psutil.Process().children())
    with gymnasium.make(ENVIRONMENT, **settings) as second:
        second.reset(seed=1)
        (process,) = set(psutil.Process().children()) - others
        process.kill()
        with pytest.raises(RunError, match=r"has ended with its process \(exit code -9\): reset begins anew"):
            second.step(WAIT)
        with pytest.raises(ResetNeeded):
            second.step(WAIT)
        assert second.reset(seed=1)[0].any()


def test_another_simulation_beside_an_open_environment_is_refused(environment: AdvisoryEnv, road: Path) -> None:
    def simulate() -> None:
        record(load(road), 1, TrafficSettings(run_in_s=0.0, duration_s=1.0), ManeuverSettings(**LEFT_ALONE))

    environment.reset(seed=1)
    with pytest.raises(InputError, match=r"another simulation is open in this process.*close that one first"):
        simulate()
    environment.step(np.array(WAIT))  # it goes on
    environment.close()
    simulate()


BESIDE = {
    "start": lambda libsumo, network: libsumo.start(["sumo", "-n", network, "--no-step-log"]),
    "load": lambda libsumo, network: libsumo.load(["-n", network, "--no-step-log"]),
    "step": lambda libsumo, _: libsumo.simulationStep(),
    "close": lambda libsumo, _: libsumo.close(),
}
"""What code of the user's own may do with libsumo."""


@pytest.mark.parametrize("way", BESIDE)
@pytest.mark.parametrize("action", [0, 2])
def test_other_code_that_takes_the_simulation_away_is_noticed(
    environment: AdvisoryEnv, road: Path, way: str, action: int
) -> None:
    environment.reset(seed=1)
    import libsumo

    BESIDE[way](libsumo, str(load(road).network))
    theirs = way in ("start", "load")
    try:
        with pytest.raises(RunError, match="other code in this process has used libsumo") as caught:
            environment.step(np.full(3, action))
        assert "\n" not in str(caught.value)
        environment.close()
        assert libsumo.simulation.isLoaded() == theirs
    finally:
        if theirs:
            libsumo.close()
    environment.reset(seed=1)


@pytest.mark.slow
def test_beside_the_users_own_simulation_it_gets_a_process_of_its_own(environment: AdvisoryEnv, road: Path) -> None:
    expected = environment.reset(seed=1)[0]
    environment.close()
    import libsumo

    libsumo.start(["sumo", "-n", str(load(road).network), "--no-step-log"])
    try:
        np.testing.assert_array_equal(environment.reset(seed=1)[0], expected)
        environment.step(np.array(WAIT))
        libsumo.simulationStep()
        assert libsumo.simulation.getTime() == 1.0
    finally:
        libsumo.close()


def opened() -> list[str]:
    """What this process has open: files, pipes, and processes; and the simulations' folders."""
    places = [os.readlink(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd") if _is_open(name)]
    children = [str(child.pid) for child in psutil.Process().children()]
    return sorted([*places, *children, *glob.glob(f"{tempfile.gettempdir()}/cosim-*")])


def _is_open(descriptor: str) -> bool:
    return os.path.exists(f"/proc/self/fd/{descriptor}") or os.path.islink(f"/proc/self/fd/{descriptor}")


@pytest.fixture
def own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the system does not list what is open there")
@pytest.mark.usefixtures("own_temporary_folder")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "end", ["forgotten", *(pytest.param(end, marks=pytest.mark.slow) for end in ("closed", "truncated"))]
)
def test_nothing_stays_open(settings: dict[str, Any], end: str) -> None:
    AdvisoryEnv(**settings).reset(seed=1)  # imports what it needs
    gc.collect()
    before = opened()
    environments = [AdvisoryEnv(**settings) for _ in range(1 if end == "truncated" else 2)]
    for environment in environments:
        environment.reset(seed=1)
    assert len(opened()) > len(before) + 1
    gc.disable()  # a forgotten one ends without it
    try:
        for environment in environments:
            if end == "truncated":
                while not environment.step(np.array(WAIT))[3]:
                    pass
            if end != "forgotten":
                environment.close()
        del environment
        environments.clear()
        assert opened() == before
    finally:
        gc.enable()


LEFT_OPEN = """
import gymnasium, sys
import isac_cosim.gym
if __name__ != "__main__":
    raise SystemExit("a process of its own began with the script")
pair = [gymnasium.make(isac_cosim.gym.ENVIRONMENT, **eval(sys.argv[1])) for _ in range(2)]
for environment in pair:
    environment.reset(seed=1)
print("both run")
"""


@pytest.mark.slow
def test_a_script_that_closes_nothing_ends_quietly(settings: dict[str, Any], tmp_path: Path) -> None:
    script, temporary = tmp_path / "script.py", tmp_path / "temporary"
    script.write_text(LEFT_OPEN)
    temporary.mkdir()
    done = subprocess.run(
        [sys.executable, script, repr(settings)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, "both run\n"), done.stderr
    assert done.stderr == ""
    assert list(temporary.glob("cosim-*")) == []


def test_files_beside_the_scenario_may_change_meanwhile(environment: AdvisoryEnv, road: Path, tmp_path: Path) -> None:
    """As where an agent is stored in the folder in which its training runs."""
    environment.reset(seed=1)
    agent = road / "agent.zip"
    try:
        agent.write_text("trained")
        environment.step(np.array(WAIT))
        environment.close()
    finally:
        agent.unlink()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "times": ({"every_s": 0.01}, r"every_s 0\.01 s: give a multiple of the 0\.1 s between two decisions"),
    "no slots": ({"slots": 0}, "environment: slots: must be at least 1, not 0"),
    "endless": ({"duration_s": float("inf")}, "environment: duration_s: must be"),
    "sensor": ({"sensor": "isack"}, "isac"),
    "unknown": ({"duration": 3.0}, "environment: duration: unknown key; did you mean duration_s"),
    "inner": (
        {"settings": {"advisories": {"compliance": 2.0}}},
        r"settings\.advisories\.compliance: must be at most 1",
    ),
    "mode": ({"render_mode": "human"}, "render_mode 'human': give rgb_array"),
    "run": ({"run": "nowhere"}, "nowhere"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_wrong_arguments_are_refused_in_one_line(settings: dict[str, Any], fault: str) -> None:
    wrong, message = WRONG[fault]
    with pytest.raises(InputError, match=message) as caught:
        AdvisoryEnv(**{**settings, **wrong})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("action", [[0, 0], [0, 0, 4], [0, 0, -1], [0.5, 0, 0], "slow", None])
def test_a_wrong_action_is_refused_and_the_episode_goes_on(environment: AdvisoryEnv, action: Any) -> None:
    environment.reset(seed=1)
    with pytest.raises(InputError, match="give 3 whole numbers from 0 to 3, one a slot"):
        environment.step(action)
    environment.step(np.array(WAIT))


def test_a_scenario_in_which_nobody_is_sensed_is_refused(settings: dict[str, Any], tmp_path: Path) -> None:
    alone = straight_road(tmp_path / "alone", vehicle("a"))
    with (
        AdvisoryEnv(**{**settings, "scenario": alone, "duration_s": 4.0}) as environment,
        pytest.raises(InputError, match="no connected vehicle follows a sensed one within 4 s after the run-in"),
    ):
        environment.reset(seed=1)


def test_there_is_nothing_to_do_before_a_reset_and_after_the_end(environment: AdvisoryEnv) -> None:
    with pytest.raises(ResetNeeded):
        environment.step(np.array(WAIT))
    played(environment, 0)
    with pytest.raises(ResetNeeded):
        environment.step(np.array(WAIT))


def test_frames_show_the_last_action_also_after_the_end(settings: dict[str, Any]) -> None:
    with AdvisoryEnv(render_mode="rgb_array", **{**settings, "every_s": 2.0}) as environment:
        assert environment.metadata["render_fps"] == 0.5
        with pytest.raises(ResetNeeded):
            environment.render()
        environment.reset(seed=1)
        frames = [environment.render()]
        truncated = False
        while not truncated:
            truncated = environment.step(np.array(WAIT))[3]
            frames.append(environment.render())
    shown = [frame.tobytes() for frame in frames if frame is not None]
    assert len(shown) == len(frames)
    assert len(set(shown)) >= len(frames) - 1


def two_at_once(context: str, settings: dict[str, Any]) -> None:
    def make() -> gymnasium.Env[Any, Any]:
        return gymnasium.make("isac_cosim.gym:isac_cosim/Advisory-v0", **settings)

    vector = AsyncVectorEnv([make] * 2, context=context)
    try:
        observations, info = vector.reset(seed=[5, 6])
        assert observations.shape == (2, 3, len(FEATURES))
        assert len(set(info["traffic_seed"].tolist())) == 2
        observations, rewards, *_ = vector.step(np.zeros((2, 3), np.int64))
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()
    finally:
        vector.close()


@pytest.mark.slow
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_several_run_as_processes(settings: dict[str, Any], context: str) -> None:
    two_at_once(context, settings)


FORKED = """
import gymnasium, sys
from tests.evaluation.closed_loop.environment.test_advisory_env import two_at_once
settings = eval(sys.argv[1])
environment = gymnasium.make("isac_cosim.gym:isac_cosim/Advisory-v0", **settings)
expected = [environment.reset(seed=1)[0], environment.step([0, 0, 0])[0]]
environment.reset(seed=1)
two_at_once("fork", settings)
assert (environment.step([0, 0, 0])[0] == expected[1]).all()
"""


@pytest.mark.slow
def test_forks_of_a_process_whose_environment_is_open_leave_it_alone(settings: dict[str, Any]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FORKED, repr(settings)], env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=ROOT,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
