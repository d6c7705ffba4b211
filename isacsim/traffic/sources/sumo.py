"""One libsumo session, from a scenario to a recording."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.sumo_files import one_line, without_outputs
from isac_cosim.isacsim.traffic.drivers.director import Director
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import let_stops_last
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWander, SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway
from isac_cosim.isacsim.traffic.recordings.recording import Incidents, Recording
from isac_cosim.isacsim.traffic.recordings.sampled_log import SampledLog
from isac_cosim.isacsim.traffic.recordings.state_log import EveryStepLog, StateLog

LOG_FILE = "messages.log"
STUCK_S = 300.0
"""How long a vehicle may stand at the head of a queue before SUMO teleports it, s. Longer than any red light."""
MISSED_EXIT_S = 20.0
"""The same for a vehicle on a fast road, in a lane that does not lead to its exit, s."""
WARNING = "Warning:"
"""The beginning of each warning in SUMO's log."""


class TrafficSettings(Settings):
    """How SUMO is stepped. By default drivers decide at human pace, in fine steps, and change lanes smoothly."""

    step_s: float = Field(
        0.01,
        gt=0.0,
        le=0.1,
        description="simulation step, and interval between recorded states, s; a whole number of milliseconds",
    )
    sample_s: float = Field(
        0.01,
        gt=0.0,
        le=1.0,
        description="longest interval at which states are taken from SUMO, s; the others are rebuilt; with step_s, all "
        "are taken",
    )
    action_step_s: float = Field(0.1, gt=0.0, le=1.0, description="interval between a driver's decisions, s")
    lateral_resolution_m: float = Field(
        5.0, gt=0.0, le=10.0, description="width of a sublane, m; wider than a lane: one a lane"
    )
    run_in_s: float = Field(90.0, ge=0.0, description="time simulated before the recording begins, s")
    duration_s: float = Field(240.0, gt=0.0, description="length of the recording, s")
    sway: SwaySettings = SwaySettings()
    speed_wander: SpeedWanderSettings = SpeedWanderSettings()


class TrafficError(RunError):
    """SUMO failed during a simulation. The message gives SUMO's reason in one line."""


@dataclass(frozen=True)
class Moment:
    """A running simulation just before one of its steps.

    sumo: the libsumo module. time_s: simulation time. recorded: whether the state at this time is recorded, as after
    the run-in. steered: for the caller to name the vehicles that it commands in this step, so that their states are
    taken from SUMO as often as those of vehicles that the director commands.
    """

    sumo: Any
    director: Director
    time_s: float
    recorded: bool
    steered: set[str] = field(default_factory=set)


def record(scenario: Scenario, seed: int, traffic: TrafficSettings, maneuvers: ManeuverSettings) -> Recording:
    """Simulate a scenario and record every vehicle's state at every step after the run-in.

    Vehicles that collided or teleported have no track and are named in `incidents`. Equal arguments give equal
    recordings. Only one simulation can run in a process at a time.
    Raises InputError where SUMO refuses the scenario, TrafficError where it fails during the simulation.
    """
    moments = record_stepwise(scenario, seed, traffic, maneuvers)
    while True:
        try:
            next(moments)
        except StopIteration as stop:
            recording: Recording = stop.value
            return recording


def record_stepwise(
    scenario: Scenario, seed: int, traffic: TrafficSettings, maneuvers: ManeuverSettings
) -> Generator[Moment, None, Recording]:
    """Do what `record` does, and pause before every step, so that the caller can read and command vehicles.

    Yields a `Moment` before each step, run-in included; returns the recording. Closing it ends the simulation.
    """
    messages: Counter[str] = Counter()
    begin = round(scenario.begin_s / traffic.step_s)
    first = begin + round(traffic.run_in_s / traffic.step_s)
    last = first + round(traffic.duration_s / traffic.step_s)
    log = state_log(scenario, traffic, first)
    with session(scenario, seed, traffic, messages, log) as sumo:
        rng = stream("maneuvers", scenario.name, seed)
        director = Director(maneuvers, scenario.sites, scenario.origin, rng, traffic.step_s, lefthand=scenario.lefthand)
        lasts_s = (last - begin) * traffic.step_s
        wander = SpeedWander(traffic.speed_wander, traffic.step_s, lasts_s, scenario.name, seed)
        try:
            for step in range(begin, last):
                moment = Moment(sumo, director, step * traffic.step_s, step >= first)
                yield moment
                wander.step(sumo, director.steered | moment.steered if wander.due else ())
                director.step(sumo, step * traffic.step_s)
                sumo.simulationStep()
                log.step(sumo, director.commanded | moment.steered)
                let_stops_last(sumo, log.parking, traffic.step_s)
            log.finish(sumo)
        except (sumo.TraCIException, sumo.FatalTraCIError) as error:
            raise TrafficError(f"{scenario.name}, seed {seed}: {one_line(error)}") from None
        finally:
            director.finish(last * traffic.step_s)
    tracks = log.tracks()
    add_sway(tracks.values(), scenario.lanes, traffic.step_s, traffic.sway, scenario.lefthand, scenario.name, seed)
    return Recording(
        scenario=scenario.name,
        seed=seed,
        step_s=traffic.step_s,
        lanes=scenario.lanes,
        tracks=tracks,
        commands=tuple(director.commands),
        incidents=Incidents(tuple(sorted(log.collided)), tuple(sorted(log.teleported))),
        warnings=messages[WARNING],
        lefthand=scenario.lefthand,
        parked=log.parked(tracks),
    )


def state_log(scenario: Scenario, traffic: TrafficSettings, first: int) -> StateLog:
    """Return the log that takes states as often as the settings say. first: the first step whose outcome it records."""
    interval_s = min(traffic.sample_s, traffic.action_step_s)
    if interval_s < 2.0 * traffic.step_s:
        return EveryStepLog(scenario, traffic.step_s, first)
    return SampledLog(scenario, traffic.step_s, first, interval_s)


@contextlib.contextmanager
def session(
    scenario: Scenario,
    seed: int,
    traffic: TrafficSettings,
    messages: Counter[str] | None = None,
    log: StateLog | None = None,
) -> Iterator[Any]:
    """A running libsumo simulation of a scenario, closed at the end. Yields the libsumo module.

    messages: at the end, the number of SUMO's warnings is added under `WARNING`.
    log: receives the states, and can return tracks once the session has ended.
    Raises InputError where SUMO refuses the scenario, or its step is not `traffic.step_s`.
    """
    # Imported here, because loading libsumo takes a second and needs SUMO_HOME.
    import sumo as sumo_package

    os.environ["SUMO_HOME"] = sumo_package.SUMO_HOME
    import libsumo

    with tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        additional = [without_outputs(file, Path(folder)) for file in scenario.additional]
        options = {
            **scenario.kept,
            "net-file": str(scenario.network),
            "route-files": ",".join(map(str, scenario.demand)),
            "additional-files": ",".join(map(str, additional)),
            "begin": f"{scenario.begin_s:g}",
            "step-length": f"{traffic.step_s:g}",
            "default.action-step-length": f"{traffic.action_step_s:g}",
            "lateral-resolution": f"{traffic.lateral_resolution_m:g}",
            "step-method.ballistic": "true",
            "seed": str(seed % 2**31),
            "collision.action": "warn",
            "collision.check-junctions": "true",
            # A vehicle that can never move again would hold up all traffic behind it for good.
            "time-to-teleport": f"{STUCK_S:g}",
            "time-to-teleport.highways": f"{MISSED_EXIT_S:g}",
            "no-step-log": "true",
            # Warnings go to the log only, not to the console.
            "no-warnings": "true",
            "error-log": str(Path(folder) / LOG_FILE),
            "duration-log.disable": "true",
            "xml-validation": "never",
            **(log.options(Path(folder)) if log else {}),
        }
        arguments = [word for name, value in options.items() if value for word in (f"--{name}", value)]
        try:
            libsumo.start(["sumo", *arguments])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise InputError(f"SUMO refuses scenario {scenario.name} ({one_line(error)}): fix its files") from None
        try:
            if log:
                log.attach()
            # SUMO's time is in whole milliseconds. It rounds other steps without a message.
            step_s = libsumo.simulation.getDeltaT()
            if abs(step_s - traffic.step_s) > 1e-9:
                raise InputError(
                    f"SUMO steps at {step_s:g} s, not at step_s = {traffic.step_s:g}: give whole milliseconds"
                )
            yield libsumo
        finally:
            libsumo.close()
            if messages is not None:
                with (Path(folder) / LOG_FILE).open(encoding="utf-8", errors="replace") as lines:
                    messages[WARNING] += sum(line.startswith(WARNING) for line in lines)
