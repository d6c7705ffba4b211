"""The environment that Gymnasium sees.

    import gymnasium
    import isac_cosim.gym
    env = gymnasium.make("isac_cosim/Advisory-v0", scenario="motorway", run="predictor")
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

An agent sees what the network knows, which trails the simulation by the conditioning's lag; see `docs/closed_loop.md`.
"""

from __future__ import annotations

import weakref
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.evaluation.closed_loop.environment.observation import bounds
from isac_cosim.evaluation.closed_loop.environment.served import TrafficInProcess, TrafficInThread
from isac_cosim.evaluation.closed_loop.environment.settings import EnvironmentSettings
from isac_cosim.evaluation.closed_loop.environment.traffic import Traffic, TrafficHere
from isac_cosim.evaluation.closed_loop.policy import INSTRUCTIONS
from isac_cosim.isacsim.traffic.sources.one_simulation import simulation_runs

MOST_SEEDS = 5
"""So many seeds of the traffic are tried for an episode in which there is something to observe."""


class AdvisoryEnv(gymnasium.Env[Float32Array, IntArray]):
    """Traffic with advisories; one episode is one seed.

    arguments: content of `EnvironmentSettings`. Raises InputError where they are wrong.

    Observation, (slots, FEATURES): the connected vehicles that follow a sensed TV, the one that would reach it first
    in front. Action, (slots,): for each, 0 nothing, or the number of one of INSTRUCTIONS plus 1. Reward: minus the time
    that vehicles spent below 3 s of time to collision, s, all vehicles together, and minus the cost of what was sent.
    An episode is truncated at its end; it never terminates.

    SUMO runs in this process. libsumo holds one simulation a process: where one runs already at a reset, such as that
    of another environment, this environment gets a process of its own.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1.0}  # noqa: RUF012 - so by Gymnasium

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode {render_mode!r}: give rgb_array, or None for no images")
        self.render_mode = render_mode
        self._settings = checked(EnvironmentSettings, arguments, "environment")
        # As fast as it happens.
        self.metadata = {**self.metadata, "render_fps": 1.0 / self._settings.every_s}
        traffic = TrafficHere(self._settings)
        self._here = TrafficInThread(traffic)
        self._apart: TrafficInProcess | None = None
        self._traffic: Traffic | None = None
        self._ended = True
        least, most = bounds(self._settings.slots, traffic.study.dataset.pairs)
        self.observation_space = spaces.Box(least, most, dtype=np.float32)
        self.action_space = spaces.MultiDiscrete(np.full(self._settings.slots, len(INSTRUCTIONS) + 1))
        self._closing: weakref.finalize[[], AdvisoryEnv] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Begin an episode. The seed of the traffic is drawn from the environment's generator."""
        super().reset(seed=seed)
        self._ended = True
        self._traffic = self._free_traffic()
        for _ in range(MOST_SEEDS):
            traffic_seed = int(self.np_random.integers(2**31 - 1))
            observation = self._traffic.begin(traffic_seed)
            if observation is not None:
                self._ended = False
                self._close_unasked(self._traffic)
                return observation, {"traffic_seed": traffic_seed}
        self._traffic = None
        raise InputError(
            f"scenario {self._settings.scenario}: no connected vehicle follows a sensed one within "
            f"{self._settings.duration_s:g} s after the run-in, with {MOST_SEEDS} seeds: give a longer duration_s or "
            "run_in_s, or a scenario with more traffic or sites"
        )

    def step(self, action: IntArray) -> tuple[Float32Array, float, bool, bool, dict[str, Any]]:
        """Send advisories, and let traffic run until the next action."""
        if self._traffic is None or self._ended:
            raise ResetNeeded("no episode is under way: call reset() first")
        if not self.action_space.contains(chosen := np.asarray(action)):
            raise InputError(
                f"action {action}: give {self._settings.slots} whole numbers from 0 to {len(INSTRUCTIONS)}, one a slot"
            )
        self._ended = True  # where the simulation fails, too
        outcome = self._traffic.step(chosen.tolist())
        self._ended = outcome.ended
        reward = -outcome.exposure_s - self._settings.advisory_cost * outcome.sent
        info = {
            "advisories": outcome.sent,
            "ttc_below_3_s": outcome.exposure_s,
            "mean_speed_mps": outcome.mean_speed_mps,
        }
        return outcome.observation, reward, False, outcome.ended, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the road at the latest action as an image, (height, width, 3); None without a render mode."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs an environment that was made with render_mode='rgb_array'")
            return None
        if self._traffic is None:
            raise ResetNeeded("there is nothing to show yet: call reset() first")
        return self._traffic.picture()

    def close(self) -> None:
        """End the simulation, and the process if it has its own."""
        self._ended, self._traffic = True, None
        self._here.close()
        if self._apart is not None:
            self._apart.close()

    def _free_traffic(self) -> Traffic:
        """Return the traffic in this process, or in one of its own where another simulation runs in this one."""
        self._here.close()
        if self._apart is None and simulation_runs():
            self._apart = TrafficInProcess(self._settings)
        return self._apart or self._here

    def _close_unasked(self, traffic: Traffic) -> None:
        """Have a simulation end also when the environment is forgotten, and when this process ends.

        At the end of the process, what was begun last is ended first: this, and then the simulation's temporary folder.
        """
        if self._closing is not None:
            self._closing.detach()
        self._closing = weakref.finalize(self, traffic.close)
