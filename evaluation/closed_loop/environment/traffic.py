"""The traffic of an environment: one simulation after the other, in which an agent advises vehicles."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.evaluation.closed_loop.environment.observation import Observation
from isac_cosim.evaluation.closed_loop.environment.picture import RoadPicture
from isac_cosim.evaluation.closed_loop.environment.settings import EnvironmentSettings
from isac_cosim.evaluation.closed_loop.loop import ClosedLoop, Decision
from isac_cosim.evaluation.closed_loop.policy import INSTRUCTIONS, Advisory
from isac_cosim.evaluation.closed_loop.safety import driving_of
from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import run_answering
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.sensing.sensors import SENSORS
from isac_cosim.isacsim.traffic.drivers.settings import NATURAL
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import WindowShape

DEFAULT_SHAPE = WindowShape(len(KNOWN), 880, 220, 400.0, 100.0)
DANGER_TTC_S = 3.0
"""The reward counts the time that vehicles spend below this time to collision, s."""


@dataclass(frozen=True)
class StepOutcome:
    """What came of an action.

    observation: (slots, FEATURES). sent: advisories. exposure_s: time that vehicles spent below 3 s of time to
    collision, s, all together. mean_speed_mps: of all vehicles, m/s. ended: whether the episode is over.
    """

    observation: Float32Array
    sent: int
    exposure_s: float
    mean_speed_mps: float
    ended: bool


class Traffic(Protocol):
    """Simulations with advisories, one after the other."""

    def begin(self, seed: int) -> Float32Array | None:
        """End the latest simulation and begin the next, up to the first action. Returns the observation, (slots, F).

        None if there is none to be made: no TV is known at any time of the simulation, which has ended.
        """

    def step(self, action: Sequence[int]) -> StepOutcome:
        """Send advisories, and simulate up to the next action. action: a number for each slot, (slots,)."""

    def picture(self) -> npt.NDArray[np.uint8]:
        """Return what the network knows at the latest action as an image, (height, width, 3)."""

    def close(self) -> None:
        """End the simulation."""


class TrafficHere:
    """`Traffic` in the thread that asks. Raises InputError where the settings do not fit together."""

    def __init__(self, settings: EnvironmentSettings) -> None:
        infer = None if settings.run is None else Infer.load(Path(settings.run))
        self._settings, self.study = settings, _study(settings, infer)
        self._shape = DEFAULT_SHAPE if infer is None else infer.run.card.shape
        self._answering = None if infer is None else run_answering(infer)
        self._scenario = load(settings.scenario)
        SENSORS[settings.sensor]  # refuses one that is not known
        every_s, decision_s = settings.every_s, self.study.live.streams.decision_s
        self._decisions_per_step = round(every_s / decision_s)
        if self._decisions_per_step < 1 or abs(self._decisions_per_step * decision_s - every_s) > 1e-6:
            raise InputError(f"every_s {every_s:g} s: give a multiple of the {decision_s:g} s between two decisions")
        self._loop: ClosedLoop | None = None
        self._decisions: Generator[Decision, None, Recording] | None = None
        # The latest decision, which is shown also after the end, and what was observed then.
        self._latest: Decision | None = None
        self._observed = self._observe(None)

    def begin(self, seed: int) -> Float32Array | None:
        self.close()
        settings = self._settings
        self._loop = ClosedLoop.of(
            self._scenario, seed, self.study, settings.settings, self._shape, settings.sensor, self._answering
        )
        self._decisions = self._loop.decisions()
        while (decision := self._advance()) is not None:
            if decision.knowledge.tv:
                self._observed = self._observe(decision)
                return self._observed.features
        return None

    def step(self, action: Sequence[int]) -> StepOutcome:
        sent = self._send(action)
        exposure_s, speeds = 0.0, []
        decision = None
        for _ in range(self._decisions_per_step):
            decision = self._advance()
            if decision is None:
                break
            danger_s, speed = self._measured(decision)
            exposure_s += danger_s
            speeds.append(speed)
        self._observed = self._observe(decision)
        mean_speed_mps = float(np.mean(speeds)) if speeds else 0.0
        return StepOutcome(self._observed.features, sent, exposure_s, mean_speed_mps, decision is None)

    def picture(self) -> npt.NDArray[np.uint8]:
        assert self._latest is not None, "there is a decision as soon as a simulation has begun"
        assert self._loop is not None
        return self._road.drawn(self._latest.knowledge, self._observed.vehicles, self._loop.advisor.under_way)

    def close(self) -> None:
        if self._decisions is not None:
            self._decisions.close()
        self._decisions = self._loop = self._latest = None

    @cached_property
    def _road(self) -> RoadPicture:
        return RoadPicture(self._scenario)

    def _advance(self) -> Decision | None:
        """Return the next decision; None at the end of the simulation."""
        assert self._decisions is not None, "begin a simulation first"
        decision = next(self._decisions, None)
        self._latest = decision or self._latest
        return decision

    def _observe(self, decision: Decision | None) -> Observation:
        knowledge = None if decision is None else decision.knowledge
        return Observation.of(knowledge, self._settings.slots, self.study.dataset.pairs)

    def _send(self, action: Sequence[int]) -> int:
        """Send the advisories of an action; returns how many."""
        assert self._latest is not None
        assert self._loop is not None
        asked = [(vehicle, number) for vehicle, number in zip(self._observed.vehicles, action, strict=False) if number]
        for vehicle, number in asked:
            self._loop.advisor.send(Advisory(vehicle, INSTRUCTIONS[number - 1], self._latest.moment.time_s))
        return len(asked)

    def _measured(self, decision: Decision) -> tuple[float, float]:
        """Return the time below 3 s of time to collision in the latest interval, s, and the mean speed, m/s."""
        surroundings = decision.knowledge.surroundings
        driving = driving_of(surroundings.recording, surroundings, surroundings.recording.step_s)
        danger_s = float((driving.ttc_s < DANGER_TTC_S).sum()) * self.study.live.streams.decision_s
        return danger_s, float(driving.speed.mean()) if len(driving.speed) else 0.0


def _study(settings: EnvironmentSettings, infer: Infer | None) -> LiveStudy:
    """Return the traffic of the environment: as the predictor was trained on, or with the defaults."""
    if infer is None:
        dataset = DatasetStudy.model_validate({"world": NATURAL} if settings.natural else {}).model_dump()
        dataset["sensing"]["channel"] |= {"kind": "link"}
        content = {
            "dataset": dataset | {"scenarios": (settings.scenario,)},
            "development": {"first": 2001, "last": 2001},
        }
    else:
        content = study_of(infer.run.card, settings.scenario, natural=settings.natural).model_dump()
    content["dataset"]["traffic"] |= {"duration_s": settings.duration_s, "run_in_s": settings.run_in_s}
    return checked(LiveStudy, content, "environment")
