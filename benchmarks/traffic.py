"""What recording costs beside the simulation itself, and how much faster than time itself traffic is simulated.

The bundled motorway, about 100 vehicles, simulated several times over, each time in a process of its own: by turns bare
and with every vehicle's state recorded. Both are commanded the same maneuvers, so that both see the same traffic; the
commands' time is counted apart. Recording ends with the tracks, read back from what SUMO wrote, and both end with SUMO
closed; the run-in counts for neither. Times are CPU seconds of the process.

Run: python -m benchmarks.traffic
"""

from __future__ import annotations

import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from isacsim.scenarios.scenario import load
from isacsim.seeding import stream
from isacsim.traffic.director import Director, ManeuverSettings
from isacsim.traffic.simulation import TrafficSettings, session
from isacsim.traffic.state_log import StateLog

SCENARIO = "motorway"
SEED = 1
MEASURED_S = 60.0
ROUNDS = 3
KINDS = ("bare", "recording", "recording_and_maneuvers")


@dataclass(frozen=True)
class Spent:
    """CPU seconds of one simulation: commanding, and all else. vehicles: the mean number on the road."""

    commands_s: float
    rest_s: float
    vehicles: float


def run() -> dict[str, Any]:
    """Measure; keys `ratio` (recording over bare), `ratio_with_maneuvers`, `simulated_s_per_cpu_s`, `vehicles`."""
    traffic = TrafficSettings(duration_s=MEASURED_S)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=1) as fresh:
        spent = [[fresh.submit(simulate, traffic, record).result() for record in (False, True)] for _ in range(ROUNDS)]
    seconds = {
        "bare": np.array([bare.rest_s for bare, _ in spent]),
        "recording": np.array([recorded.rest_s for _, recorded in spent]),
        "recording_and_maneuvers": np.array([recorded.rest_s + recorded.commands_s for _, recorded in spent]),
    }
    ratios = {kind: round(float(np.median(seconds["bare"] / each)), 4) for kind, each in seconds.items()}
    return {
        "ratio": ratios["recording"],
        "ratio_of": "simulated over CPU time: libsumo stepping with every vehicle's state recorded, over bare stepping",
        "ratio_with_maneuvers": ratios["recording_and_maneuvers"],
        "simulated_s_per_cpu_s": {
            kind: round(traffic.duration_s / float(np.median(each)), 1) for kind, each in seconds.items()
        },
        "vehicles": round(spent[0][0].vehicles, 1),
        "settings": {"scenario": SCENARIO, **traffic.model_dump()},
    }


def simulate(traffic: TrafficSettings, record: bool) -> Spent:
    """Simulate once, as `isacsim.traffic.simulation.record` does."""
    scenario = load(SCENARIO)
    first = round(traffic.run_in_s / traffic.step_s)
    last = first + round(traffic.duration_s / traffic.step_s)
    log = StateLog(scenario, traffic.step_s, first)
    rng = stream("maneuvers", scenario.name, SEED)
    director = Director(ManeuverSettings(), scenario.sites, scenario.origin, rng, traffic.step_s)
    commands_s = rest_s = 0.0
    vehicles: list[int] = []
    with session(scenario, SEED, traffic, log=log if record else None) as sumo:
        for step in range(last):
            begin = time.process_time()
            director.step(sumo, step * traffic.step_s)
            commanded = time.process_time()
            sumo.simulationStep()
            if record:
                log.step(sumo)
            if step >= first:
                commands_s += commanded - begin
                rest_s += time.process_time() - commanded
                vehicles.append(sumo.vehicle.getIDCount())
        director.finish(last * traffic.step_s)
        begin = time.process_time()
    if record:
        log.tracks()
    rest_s += time.process_time() - begin
    return Spent(commands_s, rest_s, float(np.mean(vehicles)))


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
