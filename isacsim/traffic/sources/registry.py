"""Motion sources: where recordings come from, by name. A study names one as `source`.

To add one, write a class with the methods of `MotionSource` and register a function that makes it from a study: here,
in `MOTION_SOURCES`, or in another package as an entry point of the group `isac_cosim.motion_sources`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.drivers.director import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources import sumo as simulation
from isac_cosim.isacsim.traffic.sources.kinematic import KinematicSource
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings

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
