"""What recording costs beside the simulation itself, and how much faster than time itself traffic is simulated.

One simulation of the bundled motorway, about 100 vehicles, in blocks of 200 steps that take turns: in the first the
bare libsumo step alone is timed, in the second recording as well, in the third the commanded maneuvers as well, which
is all that `isacsim.traffic.record` does. The maneuvers go on in all of them, so that all see the same traffic. Times
are CPU seconds of the process.

Run: python -m benchmarks.traffic
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np

from isacsim.maneuvers import Director, ManeuverSettings
from isacsim.scenario import load
from isacsim.seeding import stream
from isacsim.state_log import StateLog
from isacsim.traffic import TrafficSettings, session

SCENARIO = "motorway"
SEED = 1
BLOCK = 200
ROUNDS = 15
KINDS = ("bare", "recording", "recording_and_maneuvers")


def run() -> dict[str, Any]:
    """Measure; keys `ratio` (recording over bare), `ratio_with_maneuvers`, `simulated_s_per_cpu_s`, `vehicles`."""
    scenario, traffic = load(SCENARIO), TrafficSettings()
    spent: dict[str, list[float]] = {kind: [] for kind in KINDS}
    vehicles: list[int] = []
    with session(scenario, SEED, traffic) as sumo:
        rng = stream("maneuvers", scenario.name, SEED)
        director = Director(ManeuverSettings(), scenario.sites, scenario.origin, rng, traffic.step_s)
        log = StateLog(scenario, sumo, traffic.step_s)
        first = round(traffic.run_in_s / traffic.step_s)
        for step in range(first):
            director.step(sumo, step * traffic.step_s)
            sumo.simulationStep()
            log.incidents()
        for block in range(len(KINDS) * ROUNDS):
            kind, begin = KINDS[block % len(KINDS)], first + block * BLOCK
            spent[kind].append(sum(_step(sumo, director, log, begin + k, kind) for k in range(BLOCK)))
            vehicles.append(sumo.vehicle.getIDCount())
        director.finish((first + len(KINDS) * ROUNDS * BLOCK) * traffic.step_s)
    bare = np.array(spent["bare"])
    ratios = {kind: round(float(np.median(bare / each)), 4) for kind, each in spent.items()}
    speeds = {kind: round(BLOCK * traffic.step_s / float(np.median(each)), 1) for kind, each in spent.items()}
    return {
        "ratio": ratios["recording"],
        "ratio_of": "simulated over CPU time: libsumo stepping with every vehicle's state recorded, over bare stepping",
        "ratio_with_maneuvers": ratios["recording_and_maneuvers"],
        "simulated_s_per_cpu_s": speeds,
        "vehicles": round(float(np.mean(vehicles)), 1),
        "settings": {"scenario": SCENARIO, **traffic.model_dump()},
    }


def _step(sumo: Any, director: Director, log: StateLog, step: int, kind: str) -> float:
    """Make one step; the CPU seconds of what a kind of block times."""
    before = time.process_time()
    director.step(sumo, step * director.step_s)
    begin = time.process_time()
    sumo.simulationStep()
    stepped = time.process_time()
    if kind == "bare":
        return stepped - begin
    log.incidents()
    log.states(step + 1)
    return time.process_time() - (before if kind == "recording_and_maneuvers" else begin)


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
