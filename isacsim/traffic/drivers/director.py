"""What happens in traffic: causes that drivers react to, maneuvers without a cause, and when.

Hard events are rare in settled traffic. The director draws causes (debris in a lane, a vehicle that brakes or cuts in,
room ahead) and lets the driver model react to them. It also commands a few maneuvers without a cause, and disturbances
to which SUMO's drivers react by themselves. What there is of each, `maneuvers` has a file. The director does not label
anything: whether an event came of it is for the detectors to find in the recording.
"""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView, ending_lanes, is_parked
from isac_cosim.isacsim.traffic.drivers.handling.hazards import VehicleAhead
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps, restore
from isac_cosim.isacsim.traffic.drivers.maneuvers.closed_ramp_end import ClosedRampEndCommand, Closures
from isac_cosim.isacsim.traffic.drivers.maneuvers.debris import Litter
from isac_cosim.isacsim.traffic.drivers.maneuvers.evasion import draw_answer, draw_debris_evasion
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import ManeuverCommand, Occasion
from isac_cosim.isacsim.traffic.drivers.settings import KINDS, ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Command


@dataclass
class _Active:
    maneuver: ManeuverCommand
    steps: Steps
    start: float
    speed_factor: float


@dataclass
class Director:
    """Starts maneuvers and continues them, one call a simulation step.

    sites: in the scenario's plane, whose origin in SUMO's coordinates is `origin`, m. rng: every choice comes from it.
    step_s: simulation step, s. decision_s: interval at which commands are drawn, s. commands: those that have ended.
    lefthand: whether traffic keeps left; the faster lanes are then those to the right.
    """

    settings: ManeuverSettings
    sites: Iterable[Site]
    origin: tuple[float, float]
    rng: np.random.Generator
    step_s: float
    decision_s: float = 0.1
    commands: list[Command] = field(default_factory=list)
    lefthand: bool = False

    def __post_init__(self) -> None:
        self._sites_xy = np.array([(site.x, site.y) for site in self.sites]).reshape(-1, 2) + self.origin
        self._active: dict[str, _Active] = {}
        self._rested: dict[str, float] = {}
        # Speed factors of vehicles that vanished under command: SUMO may be teleporting them.
        self._vanished: dict[str, float] = {}
        self._steps_per_decision = round(self.decision_s / self.step_s)
        self._step = 0
        self._ending_lanes: list[str] | None = None
        self._litter = Litter()
        # A generator apart, so that closed ramps do not change what is drawn for vehicles.
        self._closures = Closures(self.settings, self.rng.spawn(1)[0])
        self._chances = np.array([getattr(self.settings, kind.rate) / 3600.0 * self.decision_s for kind in KINDS])

    def step(self, sumo: Any, time: float) -> None:
        """Send the commands of this step; call before each simulation step. time: s."""
        decides = self._step % self._steps_per_decision == 0 and not self.settings.quiet
        present = set(sumo.vehicle.getIDList()) if decides or self._active else set()
        for vehicle, active in list(self._active.items()):
            if vehicle not in present:
                active.steps.close()
                self._vanished[vehicle] = active.speed_factor
                self._end(vehicle, time)
            elif is_parked(sumo, vehicle):
                active.steps.close()
                restore(sumo, vehicle, active.speed_factor)
                self._end(vehicle, time)
            elif next(active.steps, self) is self:
                self._end(vehicle, time)
        if decides:
            for vehicle in sorted(self._vanished.keys() & present):
                restore(sumo, vehicle, self._vanished.pop(vehicle))
            self._evade_debris(sumo, time)
            self._start_maneuvers(sumo, sorted(present), time)
            if self.settings.closed_ramp_end_per_lane_hour > 0.0:
                self._close_ramps(sumo, time)
        self._step += 1

    @property
    def commanded(self) -> Set[str]:
        """The vehicles that the next step may command."""
        return self._active.keys()

    @property
    def steered(self) -> Set[str]:
        """The vehicles whose desired speed the director sets: those that it commands, and those that they overtake."""
        return set(self._active).union(*(active.maneuver.steers for active in self._active.values()))

    def finish(self, time: float) -> None:
        """End the maneuvers that are still under way when the simulation ends; SUMO must still be running."""
        for vehicle, active in list(self._active.items()):
            active.steps.close()
            self._end(vehicle, time)

    def _end(self, vehicle: str, time: float) -> None:
        ended = self._active.pop(vehicle)
        maneuver = ended.maneuver
        self.commands.append(Command(vehicle, maneuver.name, ended.start, time, maneuver.cause, maneuver.ttc_s))
        self._rested[vehicle] = time + self.settings.rest_s

    def _start(self, sumo: Any, maneuver: ManeuverCommand, time: float) -> None:
        factor = sumo.vehicle.getSpeedFactor(maneuver.vehicle)
        self._active[maneuver.vehicle] = _Active(maneuver, maneuver.steps(sumo, self.step_s), time, factor)

    def _start_and_startle(self, sumo: Any, maneuver: ManeuverCommand | None, time: float) -> None:
        """Start a maneuver, if there is one, and let the driver that it surprises look away, with some probability."""
        if maneuver is None:
            return
        self._start(sumo, maneuver, time)
        side = maneuver.startles
        if side is None:
            return
        settings, view = self.settings.evasion, DriverView(sumo, maneuver.vehicle, self.settings.look_ahead_m)
        behind = view.follower_beside(side) if side else view.follower()
        if behind is None or self.rng.random() >= settings.inattentive_share:
            return
        vehicle, gap_m = behind
        own = DriverView(sumo, vehicle, self.settings.look_ahead_m)
        if gap_m < settings.follower_s * own.speed and self._may_be_commanded(sumo, vehicle, time):
            answer = draw_answer(own, VehicleAhead(maneuver.vehicle, cut_in=bool(side)), self.settings, self.rng)
            if answer is not None and not self._before_junction(sumo, own):
                self._start(sumo, answer, time)

    def _evade_debris(self, sumo: Any, time: float) -> None:
        """Let drivers react to the debris that comes into their view."""
        noticed = self._litter.noticed(
            sumo, time, self.settings, self.rng, self.commanded, lambda name: self._may_be_commanded(sumo, name, time)
        )
        for vehicle, debris in noticed:
            view = DriverView(sumo, vehicle, self.settings.look_ahead_m)
            self._start_and_startle(sumo, draw_debris_evasion(view, debris, self.settings, self.rng), time)

    def _before_junction(self, sumo: Any, view: DriverView) -> bool:
        """Whether a junction or the end of the lane is near: a driver under command would mind neither."""
        if view.lane in self._endings(sumo) and view.lane_left_m < self.settings.junction_clear_s * view.speed:
            return True
        return view.junction_within(self.settings.junction_clear_m + self.settings.junction_clear_s * view.speed)

    def _start_maneuvers(self, sumo: Any, present: list[str], time: float) -> None:
        """Draw for every vehicle and kind of maneuver whether a command falls into this interval."""
        drawn = self.rng.random((len(present), len(self._chances))) < self._chances
        for vehicle_number, kind_number in np.argwhere(drawn):
            vehicle, kind = present[vehicle_number], KINDS[kind_number]
            if not self._may_be_commanded(sumo, vehicle, time):
                continue
            view = DriverView(sumo, vehicle, self.settings.look_ahead_m)
            if kind.near_junctions or not self._before_junction(sumo, view):
                ends = view.lane in self._endings(sumo)
                occasion = Occasion(view, self.rng, time, self.lefthand, ends, self.commanded, self._litter.drop)
                self._start_and_startle(sumo, kind.draw(occasion, self.settings), time)

    def _endings(self, sumo: Any) -> list[str]:
        """The lanes that end where their road goes on."""
        if self._ending_lanes is None:
            self._ending_lanes = ending_lanes(sumo)
        return self._ending_lanes

    def _close_ramps(self, sumo: Any, time: float) -> None:
        """Let vehicles stop before the end of a lane."""
        commands = self._closures.commands(
            sumo, self._endings(sumo), self.decision_s, self._closed_lanes(),
            lambda name: self._may_be_commanded(sumo, name, time),
        )  # fmt: skip
        for command in commands:
            self._start(sumo, command, time)

    def _closed_lanes(self) -> set[str]:
        maneuvers = (active.maneuver for active in self._active.values())
        return {maneuver.lane for maneuver in maneuvers if isinstance(maneuver, ClosedRampEndCommand)}

    def _may_be_commanded(self, sumo: Any, vehicle: str, time: float) -> bool:
        """Whether a vehicle is not under command or parked, has rested, is near a site, and not beside a closed lane.

        Beside a closed lane drivers are left alone: a commanded one would not see those that merge.
        """
        resting = self._rested.get(vehicle, 0.0) > time
        if vehicle in self._active or resting or is_parked(sumo, vehicle) or not self._near_a_site(sumo, vehicle):
            return False
        closed_edges = {sumo.lane.getEdgeID(lane) for lane in self._closed_lanes()}
        return sumo.vehicle.getRoadID(vehicle) not in closed_edges

    def _near_a_site(self, sumo: Any, vehicle: str) -> bool:
        position = np.array(sumo.vehicle.getPosition(vehicle))
        return bool((np.hypot(*(self._sites_xy - position).T) < self.settings.within_m).any())
