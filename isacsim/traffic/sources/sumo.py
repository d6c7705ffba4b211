"""One libsumo session, from a scenario to a recording."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.base.temporary import TemporaryFolder, writing_temporary
from isac_cosim.base.workers.activity import reading
from isac_cosim.isacsim.scenarios.folder_watch import unchanged
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.sumo_files import Handover, with_includes
from isac_cosim.isacsim.scenarios.xml_files import one_line
from isac_cosim.isacsim.traffic.drivers.director import Director, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWander, SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway
from isac_cosim.isacsim.traffic.drivers.vehicle_control import let_stops_last
from isac_cosim.isacsim.traffic.recordings.recording import Incidents, Recording
from isac_cosim.isacsim.traffic.recordings.sampled_log import SampledLog
from isac_cosim.isacsim.traffic.recordings.state_log import EveryStepLog, StateLog
from isac_cosim.isacsim.traffic.sources.one_simulation import HeldSimulation, TrafficError, refuse_a_second

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


@dataclass(frozen=True)
class Moment:
    """A running simulation just before one of its steps.

    sumo: the libsumo module. time_s: simulation time. recorded: whether the state at this time is recorded, as after
    the run-in. held: the simulation, to check after other code has run that it is still the same. steered: for the
    caller to name the vehicles that it commands in this step, so that their states are taken from SUMO as often as
    those of vehicles that the director commands.
    """

    sumo: Any
    director: Director
    time_s: float
    recorded: bool
    held: HeldSimulation
    steered: set[str] = field(default_factory=set)


def record(scenario: Scenario, seed: int, traffic: TrafficSettings, maneuvers: ManeuverSettings) -> Recording:
    """Simulate a scenario and record every vehicle's state at every step after the run-in.

    Vehicles that collided or teleported have no track and are named in `incidents`. Equal arguments give equal
    recordings. Only one simulation can run in a process at a time. SUMO can write nothing but temporary files.
    Raises InputError where SUMO refuses the scenario or a simulation runs already, TrafficError where SUMO fails during
    the simulation.
    """
    return landlock.confined(lambda: _record(record_stepwise(scenario, seed, traffic, maneuvers)))


def _record(moments: Generator[Moment, None, Recording]) -> Recording:
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

    Yields a `Moment` before each step, run-in included; returns the recording. Closing it ends the simulation. Raises
    TrafficError as well where the caller has ended or stepped the simulation.
    """
    messages: Counter[str] = Counter()
    begin = round(scenario.begin_s / traffic.step_s)
    first = begin + round(traffic.run_in_s / traffic.step_s)
    last = first + round(traffic.duration_s / traffic.step_s)
    log = state_log(scenario, traffic, first)
    with session(scenario, seed, traffic, messages, log) as sumo:
        held = HeldSimulation.present(sumo)
        rng = stream("maneuvers", scenario.name, seed)
        director = Director(maneuvers, scenario.sites, scenario.origin, rng, traffic.step_s, lefthand=scenario.lefthand)
        lasts_s = (last - begin) * traffic.step_s
        wander = SpeedWander(traffic.speed_wander, traffic.step_s, lasts_s, scenario.name, seed)
        try:
            for step in range(begin, last):
                moment = Moment(sumo, director, step * traffic.step_s, step >= first, held)
                yield moment
                held.check(moment.time_s, traffic.step_s)
                wander.step(sumo, director.steered | moment.steered if wander.due else ())
                director.step(sumo, step * traffic.step_s)
                sumo.simulationStep()
                log.step(sumo, director.commanded | moment.steered)
                let_stops_last(sumo, log.parking, traffic.step_s)
            log.finish(sumo)
            onward = {name: edges_ahead(sumo, name) for name in sumo.vehicle.getIDList()}
        except (sumo.TraCIException, sumo.FatalTraCIError) as error:
            raise TrafficError(f"{scenario.name}, seed {seed}: {one_line(error)}") from None
        finally:
            director.finish(last * traffic.step_s)
    tracks = {name: replace(track, onward=onward.get(name, ())) for name, track in log.tracks().items()}
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


def edges_ahead(sumo: Any, vehicle: str) -> tuple[str, ...]:
    """Return the edges that a vehicle has still to drive, from the one on which it is, or came from, on.

    Inside a junction, SUMO says that the vehicle is on the edge from which it came.
    """
    route = sumo.vehicle.getRoute(vehicle)
    return tuple(route[max(sumo.vehicle.getRouteIndex(vehicle), 0) :])


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
    log: receives the states, and can return tracks once the session has ended; closed where it ends before its time.
    Raises InputError where a simulation runs already, where SUMO refuses the scenario, or where its step is not
    `traffic.step_s`.
    """
    # Imported here, because loading libsumo takes a second and needs SUMO_HOME.
    import sumo as sumo_package

    os.environ["SUMO_HOME"] = sumo_package.SUMO_HOME
    import libsumo

    refuse_a_second(scenario.name)
    with TemporaryFolder(landlock.folder()) as temporary, _guarded(scenario):
        folder = temporary.path
        handover = Handover(folder)

        def handed(*files: Path) -> str:
            with writing_temporary():
                return ",".join(str(handover.path_of(file)) for file in files)

        options = {
            **scenario.kept,
            "net-file": handed(scenario.network),
            "route-files": handed(*scenario.demand),
            "additional-files": handed(*scenario.additional),
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
            "error-log": str(folder / LOG_FILE),
            "duration-log.disable": "true",
            "xml-validation": "never",
            **(log.options(folder) if log else {}),
        }
        files = (scenario.network, *scenario.demand, *scenario.additional)
        try:
            with reading(f"scenario {scenario.name}, seed {seed}", files):
                libsumo.start(["sumo", *_arguments(options)])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            libsumo.close()  # what it had loaded by then stays open otherwise
            raise InputError(f"SUMO refuses scenario {scenario.name} ({one_line(error)}): fix its files") from None
        held = HeldSimulation.present(libsumo)
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
        except BaseException:  # also where the caller stops before the end
            if log:
                log.close()
            raise
        finally:
            held.close()
            if messages is not None:
                with (folder / LOG_FILE).open(encoding="utf-8", errors="replace") as lines:
                    messages[WARNING] += sum(line.startswith(WARNING) for line in lines)


def _arguments(options: Mapping[str, str]) -> list[str]:
    """Options as SUMO gets them: in one word with their values, so that no value can be read as another option."""
    return [f"--{name}={value}" for name, value in options.items() if value]


def _guarded(scenario: Scenario) -> contextlib.AbstractContextManager[None]:
    """Watches the scenario's folders where SUMO runs in a thread that could write there."""
    if landlock.folder() is not None:
        return contextlib.nullcontext()
    files = (scenario.network, *scenario.demand, *scenario.additional)
    return unchanged(scenario.name, [part for file in files for part in with_includes(file)])
