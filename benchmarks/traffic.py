"""What recording costs beside the simulation itself, and how much faster than real time traffic is simulated.

The bundled motorway, with about 100 vehicles, is simulated several times, each time in a new process: in turn bare,
with every vehicle's state recorded, and with recording from samples (`traffic.sample_s`). All get the same commanded
maneuvers, and so the same traffic; the time of the commands is counted separately. Recording includes reading SUMO's
file back and rebuilding the states between samples, and all include closing SUMO. The run-in is not counted. Times are
CPU seconds of the process.

Run: python -m isac_cosim.benchmarks.traffic
"""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.files import json_text
from isac_cosim.base.seeding import stream
from isac_cosim.benchmarks.ratios import Ratio
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.director import Director
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, session, state_log

SCENARIO = "motorway"
SEED = 1
MEASURED_S = 60.0
ROUNDS = 3
RATIOS = (
    Ratio(("ratio",), "stepping with every state recorded over bare stepping", "SUMO writing 100 states a second"),
    Ratio(("ratio_sampled",), "the same from samples", "asking libsumo for 10 states a second"),
    Ratio(("ratio_with_maneuvers",), "every state, with the director's commands", "TraCI calls for each vehicle"),
)


@dataclass(frozen=True)
class SteppingTime:
    """CPU seconds of one simulation: of the commands, and of the rest. vehicles: mean number on the road."""

    commands_s: float
    rest_s: float
    vehicles: float


def run() -> dict[str, Any]:
    """Measure.

    Returns `ratio` (recording over bare), `ratio_sampled`, `ratio_with_maneuvers`, `simulated_s_per_cpu_s` and
    `vehicles`.
    """
    traffic = TrafficSettings(duration_s=MEASURED_S)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=1) as fresh:
        sampled = traffic.model_copy(update={"sample_s": traffic.action_step_s})
        runs = ((traffic, False), (traffic, True), (sampled, True))
        spent = [[fresh.submit(simulate, *run).result() for run in runs] for _ in range(ROUNDS)]
    seconds = {
        "bare": np.array([bare.rest_s for bare, _, _ in spent]),
        "recording": np.array([recorded.rest_s for _, recorded, _ in spent]),
        "recording_sampled": np.array([recorded.rest_s for _, _, recorded in spent]),
        "recording_and_maneuvers": np.array([recorded.rest_s + recorded.commands_s for _, recorded, _ in spent]),
    }
    ratios = {kind: round(float(np.median(seconds["bare"] / cpu_s)), 4) for kind, cpu_s in seconds.items()}
    return {
        "ratio": ratios["recording"],
        "ratio_of": "simulated over CPU time: libsumo stepping with every vehicle recorded, over bare stepping",
        "ratio_sampled": ratios["recording_sampled"],
        "ratio_with_maneuvers": ratios["recording_and_maneuvers"],
        "simulated_s_per_cpu_s": {
            kind: round(traffic.duration_s / float(np.median(cpu_s)), 1) for kind, cpu_s in seconds.items()
        },
        "vehicles": round(spent[0][0].vehicles, 1),
        "settings": {"scenario": SCENARIO, **traffic.model_dump()},
    }


def simulate(traffic: TrafficSettings, record: bool) -> SteppingTime:
    """Simulate once, in the way of `isacsim.traffic.sources.sumo.record`."""
    scenario = load(SCENARIO)
    first = round(traffic.run_in_s / traffic.step_s)
    last = first + round(traffic.duration_s / traffic.step_s)
    log = state_log(scenario, traffic, first)
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
                log.step(sumo, director.commanded)
            if step >= first:
                commands_s += commanded - begin
                rest_s += time.process_time() - commanded
                vehicles.append(sumo.vehicle.getIDCount())
        director.finish(last * traffic.step_s)
        begin = time.process_time()
        if record:
            log.finish(sumo)
    if record:
        log.tracks()
    rest_s += time.process_time() - begin
    return SteppingTime(commands_s, rest_s, float(np.mean(vehicles)))


if __name__ == "__main__":
    print(json_text(run(), 2))
