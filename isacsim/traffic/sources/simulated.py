"""The motion source `sumo`: traffic that SUMO simulates, with what the director makes happen in it."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import ClassVar

from isac_cosim.base.files import digests_of
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.remarks import remarks
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.sumo_files import with_includes
from isac_cosim.isacsim.traffic.drivers.driver_types import limits_at_thresholds
from isac_cosim.isacsim.traffic.drivers.settings import NATURAL, WORLDS, ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.sumo import Moment, TrafficSettings, record, record_stepwise

CPU_S = 0.136
"""Processor time of a simulated second in steps of 0.01 s, s: the bundled motorway on one thread."""
SAMPLE_S = 240 / 140
"""Simulated time that a recording needs for each sample that the selection allows, to give nine tenths of them, s."""


@dataclass(frozen=True)
class SumoSource(MotionSource):
    """Traffic simulated by SUMO, with commanded maneuvers. It runs, so it can be watched and commanded."""

    traffic: TrafficSettings
    maneuvers: ManeuverSettings
    sections: ClassVar = {"traffic": TrafficSettings, "maneuvers": ManeuverSettings}
    worlds, natural, duration = WORLDS, NATURAL, ("traffic", "duration_s")

    def load(self, where: str) -> Scenario:
        return scenario.load(where)

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return inputs_of(scenario)

    def digest(self, scenario: Scenario) -> str:
        return digest_of(scenario)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        return record(scenario, seed, self.traffic, self.maneuvers)

    def run(self, scenario: Scenario, seed: int) -> Generator[Moment, None, Recording]:
        return record_stepwise(scenario, seed, self.traffic, self.maneuvers)

    def remarks(self, scenario: Scenario) -> Sequence[str]:
        return remarks(scenario)

    def drivers_at(self, scenario: Scenario, thresholds: Mapping[str, float]) -> Sequence[str]:
        files = (*scenario.demand, *scenario.additional)
        return () if self.traffic.drivers == "ours" else limits_at_thresholds(files, thresholds)

    def expected_cpu_s(self) -> float:
        # Smaller or larger steps than the usual 0.01 s cost in proportion.
        return (self.traffic.run_in_s + self.traffic.duration_s) * 0.01 / self.traffic.step_s * CPU_S

    def expected_samples(self) -> float:
        return self.traffic.duration_s / SAMPLE_S


def inputs_of(scenario: Scenario) -> dict[str, str]:
    """Return a digest of each SUMO file of a scenario, and of what else of its configuration shapes the traffic."""
    files = (scenario.network, *scenario.demand, *scenario.additional)
    digests = digests_of(part for file in files for part in with_includes(file))
    read = [[file.name for file in part] for part in (scenario.demand, scenario.additional)]
    configuration = json.dumps([scenario.begin_s, dict(scenario.kept), *read], sort_keys=True)
    return digests | {"the configuration": sha256(configuration.encode()).hexdigest()}


def digest_of(scenario: Scenario) -> str:
    """Return one digest of a scenario's SUMO files, its begin and its options that shape the traffic."""
    digest = sha256()
    for path in (scenario.network, *scenario.demand, *scenario.additional):
        for part in with_includes(path):
            digest.update(f"{part.name} {part.stat().st_size}\n".encode())
            digest.update(part.read_bytes())
    if scenario.begin_s or scenario.kept:
        digest.update(json.dumps([scenario.begin_s, dict(scenario.kept)], sort_keys=True).encode())
    return digest.hexdigest()
