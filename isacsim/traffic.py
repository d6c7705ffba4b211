"""One libsumo session, from a scenario to a recording."""

from __future__ import annotations

import contextlib
import os
import tempfile
from array import array
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from isacsim.errors import InputError
from isacsim.maneuvers import Director, ManeuverSettings
from isacsim.recording import Incidents, Recording, Track
from isacsim.scenario import Scenario
from isacsim.seeding import stream
from isacsim.settings import Settings
from isacsim.sumo_files import one_line, without_outputs


class TrafficSettings(Settings):
    """How SUMO is stepped. Defaults: decide at human pace, integrate finely, move sideways smoothly."""

    step_s: float = Field(0.01, gt=0.0, le=0.1, description="simulation step, s; a whole number of milliseconds")
    action_step_s: float = Field(0.1, gt=0.0, le=1.0, description="interval of drivers' decisions, s")
    lateral_resolution_m: float = Field(0.8, gt=0.0, le=3.0, description="sublane width, m")
    run_in_s: float = Field(90.0, ge=0.0, description="simulated before the recording begins, s")
    duration_s: float = Field(240.0, gt=0.0, description="length of the recording, s")


class TrafficError(RuntimeError):
    """SUMO failed during a simulation. The message is SUMO's, in one line."""


def record(scenario: Scenario, seed: int, traffic: TrafficSettings, maneuvers: ManeuverSettings) -> Recording:
    """Simulate a scenario and record every vehicle's state at every step after the run-in.

    Vehicles that collided or teleported are left out of the tracks and named in `incidents`. Equal arguments give
    an equal recording. Only one simulation can run in a process at a time.
    Raises InputError when SUMO refuses the scenario, TrafficError when it fails on the way.
    """
    with session(scenario, seed, traffic) as sumo:
        director = Director(
            maneuvers, scenario.sites, scenario.origin, stream("maneuvers", scenario.name, seed), traffic.step_s
        )
        log = _Log(scenario, sumo)
        begin = round(scenario.begin_s / traffic.step_s)
        first = begin + round(traffic.run_in_s / traffic.step_s)
        last = first + round(traffic.duration_s / traffic.step_s)
        try:
            for step in range(begin, last):
                director.step(sumo, step * traffic.step_s)
                sumo.simulationStep()
                log.incidents()
                if step >= first:
                    log.states(step + 1)
        except (sumo.TraCIException, sumo.FatalTraCIError) as error:
            raise TrafficError(f"{scenario.name}, seed {seed}: {one_line(error)}") from error
        finally:
            director.finish(last * traffic.step_s)
        return Recording(
            scenario=scenario.name,
            seed=seed,
            step_s=traffic.step_s,
            lanes=scenario.lanes,
            tracks=log.tracks(),
            commands=tuple(director.commands),
            incidents=Incidents(tuple(sorted(log.collided)), tuple(sorted(log.teleported))),
        )


@contextlib.contextmanager
def session(scenario: Scenario, seed: int, traffic: TrafficSettings) -> Iterator[Any]:
    """A running libsumo simulation of a scenario, closed at the end. Nothing but the input files is taken from it."""
    # Imported here: loading it costs a second and it needs SUMO_HOME.
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
            "time-to-teleport": "-1",
            "no-step-log": "true",
            "no-warnings": "true",
            "duration-log.disable": "true",
            "xml-validation": "never",
        }
        arguments = [word for name, value in options.items() if value for word in (f"--{name}", value)]
        try:
            libsumo.start(["sumo", *arguments])
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise InputError(f"SUMO refuses scenario {scenario.name}: {one_line(error)}") from None
        try:
            # SUMO's time is whole milliseconds: it rounds what it cannot hold, and says nothing.
            step_s = libsumo.simulation.getDeltaT()
            if abs(step_s - traffic.step_s) > 1e-9:
                raise InputError(f"SUMO steps at {step_s} s, not at step_s = {traffic.step_s:g}: ask for whole ms")
            yield libsumo
        finally:
            libsumo.close()


class _Log:
    """What the simulation shows, step by step: one flat buffer a column, split by vehicle at the end."""

    def __init__(self, scenario: Scenario, sumo: Any) -> None:
        vehicle = sumo.vehicle
        lane_number = {lane.id: k for k, lane in enumerate(scenario.lanes)}
        self._sumo = sumo
        self._origin = scenario.origin
        self._vehicle_number: dict[str, int] = {}
        self._kinds: list[tuple[str, float, float]] = []
        self._steps = array("q")
        self._counts = array("q")
        # One C-level loop a column is three times as fast as a Python loop over vehicles.
        self._columns: dict[str, tuple[array[Any], Callable[[tuple[str, ...]], Iterable[Any]]]] = {
            "vehicle": (array("q"), self._numbers),
            "position": (array("d"), lambda ids: chain.from_iterable(map(vehicle.getPosition, ids))),
            "speed": (array("d"), lambda ids: map(vehicle.getSpeed, ids)),
            "lane": (array("i"), lambda ids: map(lane_number.__getitem__, map(vehicle.getLaneID, ids))),
            "lane_pos": (array("d"), lambda ids: map(vehicle.getLanePosition, ids)),
            "lane_lat": (array("d"), lambda ids: map(vehicle.getLateralLanePosition, ids)),
        }
        self.collided: set[str] = set()
        self.teleported: set[str] = set()

    def incidents(self) -> None:
        """Note the vehicles that collided or teleported in this step."""
        for collision in self._sumo.simulation.getCollisions():
            self.collided |= {collision.collider, collision.victim}
        self.teleported.update(self._sumo.simulation.getStartingTeleportIDList())

    def states(self, step: int) -> None:
        """Note the state of every vehicle on the road after this step."""
        ids = self._sumo.vehicle.getIDList()
        self._steps.append(step)
        self._counts.append(len(ids))
        for buffer, read in self._columns.values():
            buffer.extend(read(ids))

    def _numbers(self, ids: tuple[str, ...]) -> Iterable[int]:
        """Numbers of vehicles by first appearance; the fixed facts of a new one are noted."""
        vehicle = self._sumo.vehicle
        for name in ids:
            if name not in self._vehicle_number:
                self._vehicle_number[name] = len(self._kinds)
                self._kinds.append((vehicle.getVehicleClass(name), vehicle.getLength(name), vehicle.getWidth(name)))
        return map(self._vehicle_number.__getitem__, ids)

    def tracks(self) -> dict[str, Track]:
        """Tracks by vehicle, in order of first appearance, without those that had an incident."""
        columns = {name: np.frombuffer(buffer, buffer.typecode) for name, (buffer, _) in self._columns.items()}
        vehicle = columns.pop("vehicle")
        columns["x"], columns["y"] = columns.pop("position").reshape(-1, 2).T
        step = np.repeat(np.array(self._steps), np.array(self._counts))
        order = np.argsort(vehicle, kind="stable")
        ends = np.cumsum(np.bincount(vehicle, minlength=len(self._kinds)))
        tracks = {}
        for name, number in self._vehicle_number.items():
            if name in self.collided or name in self.teleported:
                continue
            kind, length, width = self._kinds[number]
            mine = order[ends[number - 1] if number else 0 : ends[number]]
            tracks[name] = Track(
                vehicle=name,
                kind=kind,
                length_m=length,
                width_m=width,
                first_step=int(step[mine[0]]),
                x=columns["x"][mine] - self._origin[0],
                y=columns["y"][mine] - self._origin[1],
                speed=columns["speed"][mine],
                lane=columns["lane"][mine],
                lane_pos=columns["lane_pos"][mine],
                lane_lat=columns["lane_lat"][mine],
            )
        return tracks
