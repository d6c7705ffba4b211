"""One libsumo session, from a scenario to a recording."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.base.temporary import TemporaryFolder, writing_temporary
from isac_cosim.base.workers.activity import reading
from isac_cosim.isacsim.scenarios.demand_order import first_departure_s, in_order
from isac_cosim.isacsim.scenarios.folder_watch import unchanged
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.sumo_files import Handover, with_includes
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full
from isac_cosim.isacsim.scenarios.xml_files import one_line
from isac_cosim.isacsim.traffic.drivers.director import Director
from isac_cosim.isacsim.traffic.drivers.driver_types import OurDrivers
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import let_stops_last
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWander, SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway
from isac_cosim.isacsim.traffic.recordings.recording import Incidents, Recording
from isac_cosim.isacsim.traffic.recordings.sampled_log import SampledLog
from isac_cosim.isacsim.traffic.recordings.state_log import EveryStepLog, StateLog
from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning, heard, reason_of, warnings_in
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts, discarded
from isac_cosim.isacsim.traffic.sources.one_simulation import HeldSimulation, TrafficError, refuse_a_second
from isac_cosim.isacsim.traffic.sources.sumo_library import load_libsumo

LOG_FILE = "messages.log"
STUCK_S = 300.0
"""How long a vehicle may stand at the head of a queue before SUMO teleports it, s. Longer than any red light."""
MISSED_EXIT_S = 65.0
"""The same for a vehicle on a fast road, in a lane that does not lead to its exit, s. Longer than a ramp is closed."""
DRAWN_WITHIN_S = 60.0
"""Departures that are drawn anew lie within this after those of the demand, s: within the run-in, so that traffic is as
dense as it should be when the recording begins."""


class TrafficSettings(Settings):
    """How SUMO is stepped. By default drivers decide at human pace, in fine steps, and change lanes smoothly."""

    step_s: float = Field(
        0.01,
        ge=0.001,
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
    run_in_s: float = Field(90.0, ge=0.0, le=1e6, description="time simulated before the recording begins, s")
    duration_s: float = Field(240.0, gt=0.0, le=1e6, description="length of the recording, s")
    demand: Literal["as_given", "drawn"] = Field(
        "as_given",
        description="drawn: every vehicle departs up to a minute later than the demand says, drawn anew in each seed",
    )
    drivers: Literal["theirs", "ours"] = Field(
        "theirs", description="who drives the demand's cars and trucks: its own vehicle types, or our drivers"
    )
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
    warnings: list[SumoWarning] = []
    given_up = 0
    begin = round(scenario.begin_s / traffic.step_s)
    first = begin + round(traffic.run_in_s / traffic.step_s)
    last = first + round(traffic.duration_s / traffic.step_s)
    log = state_log(scenario, traffic, first)
    with session(scenario, seed, traffic, warnings, log) as sumo:
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
            given_up = discarded(sumo, log.departed)
            onward = {name: edges_ahead(sumo, name) for name in sumo.vehicle.getIDList()}
        except (sumo.TraCIException, sumo.FatalTraCIError) as error:
            raise TrafficError(f"{scenario.name}, seed {seed}: {one_line(error)}") from None
        finally:
            director.finish(last * traffic.step_s)
    tracks = {name: replace(track, onward=onward.get(name, ())) for name, track in log.tracks().items()}
    add_sway(tracks.values(), scenario.lanes, traffic.step_s, traffic.sway, scenario.lefthand, scenario.name, seed)
    files = (*scenario.demand, *scenario.additional)
    facts = TrafficFacts(
        from_s=first * traffic.step_s,
        to_s=last * traffic.step_s,
        vehicles=len(log.departed),
        by_class=dict(sorted(Counter(log.departed.values()).items())),
        discarded=given_up,
        recorded=len(tracks),
        first_departure_s=None if tracks else first_departure_s(files, scenario.begin_s),
        warnings=tuple(warnings),
    )
    return Recording(
        scenario=scenario.name,
        seed=seed,
        step_s=traffic.step_s,
        lanes=scenario.lanes,
        tracks=tracks,
        commands=tuple(director.commands),
        incidents=Incidents(tuple(sorted(log.collided)), tuple(sorted(log.teleported))),
        facts=facts,
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
    warnings: list[SumoWarning] | None = None,
    log: StateLog | None = None,
) -> Iterator[Any]:
    """A running libsumo simulation of a scenario, closed at the end. Yields the libsumo module.

    warnings: takes SUMO's warnings, by kind, at the end.
    log: receives the states, and can return tracks once the session has ended; closed where it ends before its time.
    Raises InputError where a simulation runs already, where SUMO refuses the scenario, where its step is not
    `traffic.step_s`, or where it does not begin at a whole number of steps.
    """
    libsumo = load_libsumo()
    refuse_a_second(scenario.name)
    with TemporaryFolder(landlock.folder()) as temporary, _guarded(scenario):
        folder = temporary.path
        ours = OurDrivers((scenario.name, seed)) if traffic.drivers == "ours" else None
        handover = Handover(folder, ours.replaced if ours else None)

        def handed(*files: Path) -> str:
            with writing_temporary():
                return ",".join(str(handover.path_of(file)) for file in files)

        def demand_file(file: Path) -> str:
            with writing_temporary():
                return str(in_order(file, handover.path_of(file), folder, scenario.begin_s))

        additional = handed(*scenario.additional)  # SUMO reads these first
        demand = ",".join(map(demand_file, scenario.demand))
        if ours and (default_type := ours.default_type()):
            with writing_temporary():
                path = folder / "default-type.add.xml"
                path.write_text(default_type, encoding="utf-8")
            additional = ",".join(filter(None, (str(path), additional)))
        options = {
            **scenario.kept,
            **({"random-depart-offset": f"{DRAWN_WITHIN_S:g}"} if traffic.demand == "drawn" else {}),
            "net-file": handed(scenario.network),
            "route-files": demand,
            "additional-files": additional,
            "begin": in_full(scenario.begin_s),
            "step-length": in_full(traffic.step_s),
            "default.action-step-length": in_full(traffic.action_step_s),
            "lateral-resolution": in_full(traffic.lateral_resolution_m),
            "step-method.ballistic": "true",
            "seed": str(seed % 2**31),
            "collision.action": "warn",
            "collision.check-junctions": "true",
            # A vehicle that can never move again would hold up all traffic behind it for good.
            "time-to-teleport": in_full(STUCK_S),
            "time-to-teleport.highways": in_full(MISSED_EXIT_S),
            "no-step-log": "true",
            # Warnings go to the log only, not to the console.
            "no-warnings": "true",
            "error-log": str(folder / LOG_FILE),
            "duration-log.disable": "true",
            "xml-validation": "never",
            **(log.options(folder) if log else {}),
        }
        files = (scenario.network, *scenario.demand, *scenario.additional)
        folders = (folder, *(file.parent for file in files), *(file.resolve().parent for file in files))
        try:
            with reading(f"scenario {scenario.name}, seed {seed}", files), heard(folder) as said:
                libsumo.start(["sumo", *_arguments(options)])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            libsumo.close()  # what it had loaded by then stays open otherwise
            reason = reason_of(error, said, folders)
            raise InputError(f"SUMO refuses scenario {scenario.name} ({reason}): fix its files") from None
        held = HeldSimulation.present(libsumo)
        try:
            if log:
                log.attach()
            _check_times(libsumo, scenario, traffic.step_s)
            yield libsumo
        except BaseException:  # also where the caller stops before the end
            if log:
                log.close()
            raise
        finally:
            held.close()
            if warnings is not None:
                with (folder / LOG_FILE).open(encoding="utf-8", errors="replace") as lines:
                    warnings += warnings_in(lines, folders)


def _check_times(sumo: Any, scenario: Scenario, step_s: float) -> None:
    """Raise InputError where SUMO's clock is not that of the recording: it counts whole milliseconds, and rounds."""
    stepped_s = sumo.simulation.getDeltaT()
    if abs(stepped_s - step_s) > 1e-9:
        raise InputError(
            f"SUMO steps at {in_full(stepped_s)} s, not at step_s = {in_full(step_s)}: give whole milliseconds"
        )
    begun_s, expected_s = sumo.simulation.getTime(), round(scenario.begin_s / step_s) * step_s
    if abs(begun_s - expected_s) > 1e-6:
        raise InputError(
            f"{scenario.name}: begins at {in_full(begun_s)} s, which is no whole number of steps of {in_full(step_s)} "
            "s: give `begin` as a multiple of the step"
        )


def _arguments(options: Mapping[str, str]) -> list[str]:
    """Options as SUMO gets them: in one word with their values, so that no value can be read as another option."""
    return [f"--{name}={value}" for name, value in options.items() if value]


def _guarded(scenario: Scenario) -> contextlib.AbstractContextManager[None]:
    """Watches the scenario's folders where SUMO runs in a thread that could write there."""
    if landlock.folder() is not None:
        return contextlib.nullcontext()
    files = (scenario.network, *scenario.demand, *scenario.additional)
    return unchanged(scenario.name, [part for file in files for part in with_includes(file)])
