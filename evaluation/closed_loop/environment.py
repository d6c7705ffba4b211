"""The closed loop as a Gymnasium environment: an agent decides which connected vehicles get which advisory.

    import gymnasium
    env = gymnasium.make("isac_cosim/Advisory-v0", scenario="motorway", run="predictor")
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

An agent sees what the network knows, which trails the simulation by the conditioning's lag; see `docs/live.md`.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from gymnasium import spaces

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.evaluation.closed_loop.loop import ClosedLoop, Decision
from isac_cosim.evaluation.closed_loop.policy import INSTRUCTIONS, Advisory
from isac_cosim.evaluation.closed_loop.safety import driving_of
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import run_answering
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import NATURAL
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.samples.uv_choice import connected
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import WindowShape

FEATURES = ("present", "speed", "distance", "closing", "tv_speed", "tv_acceleration", *(known.text for known in KNOWN))
"""What is observed of each vehicle, in m, m/s and m/s2: whether the slot is taken; its reported speed; the distance to
the front of the TV ahead of it, and how fast it closes; the TV's sensed speed and acceleration along its way; the
probabilities of the TV's intentions, zero without a predictor or answer."""
DANGER_TTC_S = 3.0
"""The reward counts the time that vehicles spend below this time to collision, s."""
DEFAULT_SHAPE = WindowShape(len(KNOWN), 880, 220, 400.0, 100.0)


class AdvisoryEnv(gymnasium.Env[Float32Array, IntArray]):
    """Traffic with advisories; one episode is one seed.

    scenario: bundled name or path. run: folder of a trained predictor; None: the network senses but predicts nothing.
    duration_s, run_in_s: of an episode, s. every_s: time between two actions, s. slots: vehicles that can be advised
    at once. advisory_cost: what sending one costs, in the unit of the reward. natural: drivers are left alone.
    sensor: what senses the TVs, isac, radar or truth. settings: content of `ClosedLoopSettings`.

    Observation, (slots, FEATURES): the connected vehicles that follow a sensed TV, the one that would reach it first
    in front. Action, (slots,): for each, 0 nothing, or the number of one of INSTRUCTIONS plus 1. Reward: minus the time
    that vehicles spent below 3 s of time to collision, s, all vehicles together, and minus the cost of what was sent.
    An episode is truncated at its end; it never terminates. SUMO runs in this process, so there is one environment a
    process: run several with `gymnasium.vector.AsyncVectorEnv`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - declared so by Gymnasium
    _running: ClassVar[AdvisoryEnv | None] = None

    def __init__(
        self,
        scenario: str = "motorway",
        run: str | None = None,
        duration_s: float = 60.0,
        run_in_s: float = 90.0,
        every_s: float = 1.0,
        slots: int = 8,
        advisory_cost: float = 0.01,
        natural: bool = False,
        sensor: Literal["isac", "radar", "truth"] = "isac",
        settings: dict[str, Any] | None = None,
    ) -> None:
        infer = None if run is None else Infer.load(Path(run))
        self._shape = DEFAULT_SHAPE if infer is None else infer.run.card.shape
        self._answering = None if infer is None else run_answering(infer)
        self._study = _study(scenario, infer, duration_s, run_in_s, natural)
        self._settings = checked(ClosedLoopSettings, settings or {}, "settings")
        self._scenario = load(scenario)
        decision_s = self._study.live.streams.decision_s
        self._decisions_per_step = round(every_s / decision_s)
        if self._decisions_per_step < 1 or abs(self._decisions_per_step * decision_s - every_s) > 1e-6:
            raise InputError(f"every_s {every_s:g} s: give a multiple of the {decision_s:g} s between two decisions")
        self._slots, self._cost, self._sensor = slots, advisory_cost, sensor
        self.observation_space = spaces.Box(-np.inf, np.inf, (slots, len(FEATURES)), np.float32)
        self.action_space = spaces.MultiDiscrete(np.full(slots, len(INSTRUCTIONS) + 1))
        self._loop: ClosedLoop | None = None
        self._decisions: Generator[Decision, None, Recording] | None = None
        self._vehicles: list[str] = []
        self._decision: Decision | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Begin an episode. The seed of the traffic is drawn from the environment's generator."""
        super().reset(seed=seed)
        self.close()
        if AdvisoryEnv._running is not None:
            raise InputError("an environment is already running in this process; close it, or use AsyncVectorEnv")
        traffic_seed = int(self.np_random.integers(2**31 - 1))
        self._loop = ClosedLoop.of(
            self._scenario, traffic_seed, self._study, self._settings, self._shape, self._sensor, self._answering
        )
        self._decisions, AdvisoryEnv._running = self._loop.decisions(), self
        self._decision = self._advance()
        while self._decision is not None and not self._decision.knowledge.tv:
            self._decision = self._advance()
        return self._observation(), {"traffic_seed": traffic_seed}

    def step(self, action: IntArray) -> tuple[Float32Array, float, bool, bool, dict[str, Any]]:
        """Send advisories, and let traffic run until the next action."""
        sent = self._send(action)
        exposure_s, speeds = 0.0, []
        for _ in range(self._decisions_per_step):
            self._decision = self._advance()
            if self._decision is None:
                break
            danger_s, speed = self._measured(self._decision)
            exposure_s += danger_s
            speeds.append(speed)
        reward = -exposure_s - self._cost * sent
        info = {
            "advisories": sent,
            "ttc_below_3_s": exposure_s,
            "mean_speed_mps": float(np.mean(speeds)) if speeds else 0.0,
        }
        return self._observation(), reward, False, self._decision is None, info

    def close(self) -> None:
        """End the simulation."""
        if self._decisions is not None:
            self._decisions.close()
        self._decisions = self._decision = None
        if AdvisoryEnv._running is self:
            AdvisoryEnv._running = None

    def _advance(self) -> Decision | None:
        """Return the next decision; None at the end of the episode."""
        return None if self._decisions is None else next(self._decisions, None)

    def _send(self, action: IntArray) -> int:
        """Send the advisories of an action; returns how many."""
        if self._decision is None or self._loop is None:
            return 0
        sent = 0
        for vehicle, number in zip(self._vehicles, np.asarray(action).tolist(), strict=False):
            if number > 0:
                self._loop.advisor.send(Advisory(vehicle, INSTRUCTIONS[number - 1], self._decision.moment.time_s))
                sent += 1
        return sent

    def _measured(self, decision: Decision) -> tuple[float, float]:
        """Return the time below 3 s of time to collision in the latest interval, s, and the mean speed, m/s."""
        surroundings = decision.knowledge.surroundings
        driving = driving_of(surroundings.recording, surroundings, surroundings.recording.step_s)
        danger_s = float((driving.ttc_s < DANGER_TTC_S).sum()) * self._study.live.streams.decision_s
        return danger_s, float(driving.speed.mean()) if len(driving.speed) else 0.0

    def _observation(self) -> Float32Array:
        """Return what the network knows of the vehicles that can be advised, and note which they are."""
        observation = np.zeros((self._slots, len(FEATURES)), np.float32)
        self._vehicles = []
        if self._decision is None:
            return observation
        rows = sorted(self._followers(self._decision), key=lambda row: (_urgency(row[1]), row[0]))[: self._slots]
        for k, (vehicle, features) in enumerate(rows):
            observation[k] = features
            self._vehicles.append(vehicle)
        return observation

    def _followers(self, decision: Decision) -> list[tuple[str, Array]]:
        """Return the connected vehicles that follow a sensed TV, with their features."""
        knowledge, pairs = decision.knowledge, self._study.dataset.pairs
        recording, place = knowledge.surroundings.recording, {tv: k for k, tv in enumerate(knowledge.tv)}
        rows = []
        for vehicle, track in recording.tracks.items():
            leader = knowledge.surroundings.leader(vehicle, knowledge.time_s, pairs.range_m)
            if leader is None or leader.vehicle not in place or vehicle not in knowledge.reported:
                continue
            if connected(recording, track, pairs):
                row = place[leader.vehicle]
                probabilities = (
                    np.zeros(len(KNOWN)) if knowledge.answers is None else knowledge.answers.probabilities[row]
                )
                state = knowledge.windows[0][row, :, -1]
                rows.append((vehicle, _features(knowledge.reported[vehicle], state, probabilities)))
        return rows


def _features(reported: Array, tv: Array, probabilities: Array | Float32Array) -> Array:
    """Return the features of a vehicle. reported: its own state, (6,). tv: of the TV ahead, (6,)."""
    speed = float(np.hypot(*reported[2:4]))
    along = reported[2:4] / speed if speed > 0.1 else np.zeros(2)
    distance = float(np.hypot(*(tv[:2] - reported[:2])))
    return np.array(
        [1.0, speed, distance, speed - float(tv[2:4] @ along), float(np.hypot(*tv[2:4])), float(tv[4:6] @ along),
         *np.asarray(probabilities).tolist()]
    )  # fmt: skip


def _urgency(features: Array) -> float:
    """Return the time in which the distance to the TV closes, s; infinite where it does not."""
    distance, closing = features[2], features[3]
    return float(distance / closing) if closing > 0.0 else np.inf


def _study(scenario: str, infer: Infer | None, duration_s: float, run_in_s: float, natural: bool) -> LiveStudy:
    """Return the traffic of the environment: as the predictor was trained on, or with the defaults."""
    if infer is None:
        dataset = DatasetStudy.model_validate({"world": NATURAL} if natural else {}).model_dump()
        dataset["sensing"]["channel"] |= {"kind": "link"}
        content = {"dataset": dataset | {"scenarios": (scenario,)}, "development": {"first": 2001, "last": 2001}}
    else:
        content = study_of(infer.run.card, scenario, natural=natural).model_dump()
    content["dataset"]["traffic"] |= {"duration_s": duration_s, "run_in_s": run_in_s}
    return checked(LiveStudy, content, "environment")


ENVIRONMENT = "isac_cosim/Advisory-v0"


def register() -> None:
    """Make `gymnasium.make(ENVIRONMENT)` work. Nothing but a name is imported until an environment is made."""
    from gymnasium.envs.registration import register as register_environment
    from gymnasium.envs.registration import registry

    if ENVIRONMENT not in registry:
        register_environment(ENVIRONMENT, entry_point="isac_cosim.evaluation.closed_loop.environment:AdvisoryEnv")
