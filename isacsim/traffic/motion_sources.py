"""Motion sources: where recordings come from, by name. A study names one as `source`.

To add one, write a class with the methods of `MotionSource` and register a function that makes it from a study: here,
in `MOTION_SOURCES`, or in another package as an entry point of the group `isac_cosim.motion_sources`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from isacsim.registry import Registry
from isacsim.scenarios import scenario
from isacsim.scenarios.scenario import Scenario
from isacsim.traffic import simulation
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.kinematic_settings import KinematicSettings
from isacsim.traffic.kinematics import KinematicSource
from isacsim.traffic.recording import Recording
from isacsim.traffic.simulation import TrafficSettings

SUMO_CPU_S = 0.136
"""Processor time of a simulated second in steps of 0.01 s, s: the bundled motorway on one thread."""


class MotionSource(Protocol):
    """Where motion comes from. It is sent to worker processes, so it must pickle, and equal sources must hash equally.

    Equal sources, scenarios and seeds must give equal recordings, in every process.
    """

    def __hash__(self) -> int: ...

    def load(self, where: str) -> Scenario:
        """Return the scenario that the user named. Raises InputError where it is missing or cannot be read."""

    def record(self, scenario: Scenario, seed: int) -> Recording:
        """Return the recording of a scenario and seed.

        A source that knows what each target vehicle does returns a `LabelledRecording`. Its maneuvers become the
        samples, with its labels, and the detectors are only compared with them; otherwise they give the labels.
        Raises InputError where the scenario itself is at fault: no other seed is tried then. Any other error costs
        this seed only.
        """

    def expected_cpu_s(self) -> float:
        """Return about how much processor time one recording takes, s, for estimates."""


class MotionStudy(Protocol):
    """The parts of a study that motion sources are made from."""

    @property
    def source(self) -> str: ...

    @property
    def traffic(self) -> TrafficSettings: ...

    @property
    def maneuvers(self) -> ManeuverSettings: ...

    @property
    def kinematics(self) -> KinematicSettings: ...


@dataclass(frozen=True)
class SumoSource:
    """Traffic simulated by SUMO, with commanded maneuvers."""

    traffic: TrafficSettings
    maneuvers: ManeuverSettings

    @classmethod
    def of(cls, study: MotionStudy) -> SumoSource:
        """Return the source that a study describes."""
        return cls(study.traffic, study.maneuvers)

    def load(self, where: str) -> Scenario:
        return scenario.load(where)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        return simulation.record(scenario, seed, self.traffic, self.maneuvers)

    def expected_cpu_s(self) -> float:
        # Smaller or larger steps than the usual 0.01 s cost in proportion.
        simulated_s = (self.traffic.run_in_s + self.traffic.duration_s) * 0.01 / self.traffic.step_s
        return simulated_s * SUMO_CPU_S


MOTION_SOURCES: Registry[Callable[[MotionStudy], MotionSource]] = Registry(
    "motion source",
    {"sumo": SumoSource.of, "kinematic": lambda study: KinematicSource(study.kinematics)},
    group="isac_cosim.motion_sources",
)
"""Functions that make a motion source from a study, by the name that the study gives as `source`."""


def motion_source(study: MotionStudy) -> MotionSource:
    """Return the motion source that a study names. Raises InputError for an unknown name."""
    return MOTION_SOURCES[study.source](study)
