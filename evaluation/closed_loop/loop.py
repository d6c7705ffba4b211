"""Traffic, network and advisories together, one decision at a time."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import cast

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.closed_loop.advising import Advisor
from isac_cosim.evaluation.closed_loop.mobile_network import Knowledge, Network
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import timing_of
from isac_cosim.evaluation.in_traffic.streams.predictions import Answering
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.running.conditioning import Kernel
from isac_cosim.isacsim.sensing.running.world import World
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.registry import running_source
from isac_cosim.isacsim.traffic.sources.sumo import Moment
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.models.predictors.protocol import WindowShape


@dataclass(frozen=True)
class Decision:
    """An instant at which the network may send advisories. moment: of the simulation. knowledge: trails it."""

    moment: Moment
    knowledge: Knowledge


@dataclass
class ClosedLoop:
    """One simulation with a network that watches it.

    world, network, advisor: what the network senses, knows and does.
    """

    scenario: Scenario
    seed: int
    study: LiveStudy
    world: World
    network: Network
    advisor: Advisor

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        seed: int,
        study: LiveStudy,
        settings: ClosedLoopSettings,
        shape: WindowShape,
        sensor: str,
        answering: Answering | None,
    ) -> ClosedLoop:
        """Return the loop of a sensor. answering: how the predictor answers; None: nothing is predicted.

        Raises InputError for an unknown sensor, or where the times of the settings do not fit the simulation's steps.
        """
        dataset, timing = study.dataset, timing_of(study, shape)
        traffic = running_source(dataset).traffic
        kernel = kernel_of(study, settings)
        steps = timing.decision_s / traffic.step_s
        if abs(steps - round(steps)) > 1e-6 or kernel.ahead_rows % round(steps):
            raise InputError(
                f"decision_s {timing.decision_s:g} s: in a closed loop, it and the conditioning's reach of "
                f"{kernel.lag_s:g} s have to be multiples of the simulation's step and of each other"
            )
        rates = (shape.tv_rate_hz, shape.uv_rate_hz)
        world = World(scenario, seed, traffic, kernel, timing.decision_s, rates)
        of_sensor = study.sensor_settings
        if sensor != study.live.streams.sensor:
            of_sensor = of_sensor.model_copy(update={"radar": settings.radar})
        watch = watch_episode(dataset, scenario, seed, sensor=sensor, settings=of_sensor)
        network = Network(scenario, seed, dataset, shape, timing, watch, answering)
        advisor = Advisor(settings.advisories, (scenario.name, seed), traffic.step_s)
        return cls(scenario, seed, study, world, network, advisor)

    def decisions(self) -> Generator[Decision, None, Recording]:
        """Simulate, and pause at every decision of the recording; returns the recording. Closing it ends SUMO.

        Raises TrafficError where other code has ended or stepped the simulation meanwhile.
        """
        source = running_source(self.study.dataset)
        moments = source.run(self.scenario, self.seed)
        try:
            while True:
                try:
                    moment = next(moments)
                except StopIteration as stop:
                    return cast(Recording, stop.value)
                if not moment.recorded:
                    continue
                piece = self.world.read(moment)
                if piece is not None:
                    yield Decision(moment, self.network.learn(piece))
                    moment.held.check(moment.time_s, source.traffic.step_s)
                self.advisor.step(moment)
        finally:
            moments.close()


def kernel_of(study: LiveStudy, settings: ClosedLoopSettings) -> Kernel:
    """Return the conditioning kernel of a closed loop."""
    step_s = running_source(study.dataset).traffic.step_s
    return Kernel(settings.conditioning, study.dataset.motion.width_s, step_s)
