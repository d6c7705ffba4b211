"""What happens in traffic: causes that drivers react to, maneuvers without a cause, and when.

Hard events are rare in settled traffic. The director draws causes (debris in a lane, a vehicle that brakes or cuts in,
room ahead) and lets the driver model react to them (`reactions`). It also commands a few maneuvers
without a cause, and disturbances to which SUMO's drivers react by themselves. It does not label anything: whether an
event came of it is for the detectors to find in the recording.
"""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.traffic.drivers import command_draws as draws
from isac_cosim.isacsim.traffic.drivers.command_settings import (
    AccelCommandSettings,
    BrakeCommandSettings,
    BriskStartSettings,
    ClosedRampEndCommandSettings,
    CutInCommandSettings,
    EvasionSettings,
    LaneChangeCommandSettings,
    OvertakeCommandSettings,
    SlowVehicleCommandSettings,
    StopInLaneCommandSettings,
    SwerveCommandSettings,
)
from isac_cosim.isacsim.traffic.drivers.driver_model import DriverSettings
from isac_cosim.isacsim.traffic.drivers.hazards import Debris, VehicleAhead
from isac_cosim.isacsim.traffic.drivers.maneuvers import (
    ClosedRampEndCommand,
    CutInCommand,
    ManeuverCommand,
    OvertakeCommand,
    stopping_m,
)
from isac_cosim.isacsim.traffic.drivers.reactions import BrakeCommand, Evasion, Reaction
from isac_cosim.isacsim.traffic.drivers.vehicle_control import Steps, restore
from isac_cosim.isacsim.traffic.drivers.vehicle_view import DriverView, ending_lanes, is_parked
from isac_cosim.isacsim.traffic.recordings.recording import Command


def _rate(what: str, default: float) -> Any:
    return Field(default, ge=0.0, le=3600.0, description=f"{what}, per hour of a vehicle's driving")


class ManeuverSettings(Settings):
    """How often what happens, to whom, and what it is like. All rates zero: traffic is left alone.

    A cause or command is skipped where the surroundings do not allow it (no room to accelerate into, no lane to change
    to), so fewer happen than the rates say.
    """

    debris_per_vehicle_hour: float = _rate("debris that comes into view in the lane ahead", 20.0)
    surge_per_vehicle_hour: float = _rate("chances to accelerate hard into room ahead that are taken", 30.0)
    brisk_start_per_vehicle_hour: float = _rate("hard starts at traffic lights, of vehicles that stand there", 30.0)
    hard_brake_per_vehicle_hour: float = _rate("commanded hard brakes", 2.0)
    hard_accel_per_vehicle_hour: float = _rate("commanded hard accelerations", 1.0)
    left_change_per_vehicle_hour: float = _rate("commanded left lane changes", 2.0)
    right_change_per_vehicle_hour: float = _rate("commanded right lane changes", 2.0)
    overtake_per_vehicle_hour: float = _rate("commanded overtakes", 8.0)
    swerve_per_vehicle_hour: float = _rate("commanded evasive swerves", 0.5)
    slow_vehicle_per_vehicle_hour: float = _rate("vehicles that slow down, for others to react to", 1.0)
    stop_in_lane_per_vehicle_hour: float = _rate("vehicles that stop in their lane", 0.1)
    cut_in_per_vehicle_hour: float = _rate("lane changes close in front of another vehicle", 6.0)
    closed_ramp_end_per_lane_hour: float = Field(
        6.0,
        ge=0.0,
        le=3600.0,
        description="vehicles that stop near the end of a lane that ends, so that others have to merge before; "
        "per hour of each such lane",
    )
    rest_s: float = Field(12.0, ge=0.0, le=1e5, description="pause between two commands to one vehicle, s")
    within_m: float = Field(350.0, gt=0.0, le=1e5, description="only vehicles this close to a site are commanded, m")
    look_ahead_m: float = Field(
        150.0, gt=0.0, le=1e3, description="distance within which a vehicle counts as the one ahead, m"
    )
    junction_clear_m: float = Field(
        30.0,
        ge=0.0,
        le=1e3,
        description="nothing but a hard brake is commanded this close to a traffic light or a duty to give way, m",
    )
    junction_clear_s: float = Field(6.0, ge=0.0, le=60.0, description="added to that distance for each m/s of speed, s")
    stay_s: float = Field(
        25.0,
        ge=0.0,
        le=600.0,
        description="a vehicle is sent to a lane that misses its exit only if it can stay there this long, s",
    )
    driver: DriverSettings = DriverSettings()
    evasion: EvasionSettings = EvasionSettings()
    hard_brake: BrakeCommandSettings = BrakeCommandSettings()
    hard_accel: AccelCommandSettings = AccelCommandSettings()
    brisk_start: BriskStartSettings = BriskStartSettings()
    lane_change: LaneChangeCommandSettings = LaneChangeCommandSettings()
    overtake: OvertakeCommandSettings = OvertakeCommandSettings()
    swerve: SwerveCommandSettings = SwerveCommandSettings()
    slow_vehicle: SlowVehicleCommandSettings = SlowVehicleCommandSettings()
    stop_in_lane: StopInLaneCommandSettings = StopInLaneCommandSettings()
    cut_in: CutInCommandSettings = CutInCommandSettings()
    closed_ramp_end: ClosedRampEndCommandSettings = ClosedRampEndCommandSettings()

    @property
    def quiet(self) -> bool:
        """Whether nothing is ever commanded."""
        return not any(getattr(self, name) for name in type(self).model_fields if name.endswith("_hour"))


LEFT_ALONE = {name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")}
"""The rates of `ManeuverSettings` with which drivers are left alone."""


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
        self._steps_per_decision = round(self.decision_s / self.step_s)
        self._step = 0
        self._ending_lanes: list[str] | None = None
        self._due: dict[str, float] = {}
        self._debris: list[Debris] = []
        # When each driver notices each debris: time to collision, s.
        self._notice_s: dict[tuple[Debris, str], float] = {}
        # A generator apart, so that closed ramps do not change what is drawn for vehicles.
        self._ramp_rng = self.rng.spawn(1)[0]
        self._chances = {
            name.removesuffix("_per_vehicle_hour"): getattr(self.settings, name) / 3600.0 * self.decision_s
            for name in ManeuverSettings.model_fields
            if name.endswith("_per_vehicle_hour")
        }

    def step(self, sumo: Any, time: float) -> None:
        """Send the commands of this step; call before each simulation step. time: s."""
        decides = self._step % self._steps_per_decision == 0 and not self.settings.quiet
        present = set(sumo.vehicle.getIDList()) if decides or self._active else set()
        for vehicle, active in list(self._active.items()):
            if vehicle not in present:
                active.steps.close()
                self._end(vehicle, time)
            elif is_parked(sumo, vehicle):
                active.steps.close()
                restore(sumo, vehicle, active.speed_factor)
                self._end(vehicle, time)
            elif next(active.steps, self) is self:
                self._end(vehicle, time)
        if decides:
            self._meet_debris(sumo, time)
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
        maneuvers = (active.maneuver for active in self._active.values())
        return self.commanded | {maneuver.other for maneuver in maneuvers if isinstance(maneuver, OvertakeCommand)}

    def finish(self, time: float) -> None:
        """End the maneuvers that are still under way when the simulation ends; SUMO must still be running."""
        for vehicle, active in list(self._active.items()):
            active.steps.close()
            self._end(vehicle, time)

    def _end(self, vehicle: str, time: float) -> None:
        ended = self._active.pop(vehicle)
        maneuver = ended.maneuver
        noted = (maneuver.cause, maneuver.ttc_s) if isinstance(maneuver, Reaction) else ("", None)
        self.commands.append(Command(vehicle, maneuver.name, ended.start, time, *noted))
        self._rested[vehicle] = time + self.settings.rest_s

    def _start(self, sumo: Any, maneuver: ManeuverCommand, time: float) -> None:
        factor = sumo.vehicle.getSpeedFactor(maneuver.vehicle)
        self._active[maneuver.vehicle] = _Active(maneuver, maneuver.steps(sumo, self.step_s), time, factor)

    def _startle(self, sumo: Any, maneuver: ManeuverCommand, time: float) -> None:
        """Let the driver behind a vehicle that brakes hard or cuts in look away, with some probability."""
        settings = self.settings.evasion
        view = DriverView(sumo, maneuver.vehicle, self.settings.look_ahead_m)
        if isinstance(maneuver, CutInCommand):
            behind, cut_in = view.follower_beside(maneuver.direction), True
        elif isinstance(maneuver, BrakeCommand) or (isinstance(maneuver, Evasion) and maneuver.plan.brakes):
            behind, cut_in = view.follower(), False
        else:
            return
        if behind is None or self.rng.random() >= settings.inattentive_share:
            return
        vehicle, gap_m = behind
        own = DriverView(sumo, vehicle, self.settings.look_ahead_m)
        if gap_m < settings.follower_s * own.speed and self._may_be_commanded(sumo, vehicle, time):
            ahead = VehicleAhead(maneuver.vehicle, cut_in)
            answer = draws.draw_answer(own, ahead, settings, self.settings.driver, self.rng, self.settings.stay_s)
            if answer is not None and not self._before_junction(sumo, own):
                self._start(sumo, answer, time)

    def _meet_debris(self, sumo: Any, time: float) -> None:
        """Let drivers react to the debris that comes into their view."""
        self._debris = [debris for debris in self._debris if debris.until > time]
        for debris in self._debris:
            for vehicle in sumo.lane.getLastStepVehicleIDs(debris.lane):
                gap_m, speed = debris.gap_m(sumo, vehicle), sumo.vehicle.getSpeed(vehicle)
                notice_ttc_s = self.settings.evasion.notice_ttc_s
                if not 0.0 < gap_m < notice_ttc_s[1] * speed or vehicle in self._active:
                    continue
                key = (debris, vehicle)
                if key not in self._notice_s:
                    self._notice_s[key] = self.rng.uniform(*notice_ttc_s)
                if gap_m < self._notice_s[key] * speed and self._may_be_commanded(sumo, vehicle, time):
                    self._notice_s[key] = 0.0
                    self._evade(sumo, vehicle, debris, time)

    def _evade(self, sumo: Any, vehicle: str, debris: Debris, time: float) -> None:
        view, settings = DriverView(sumo, vehicle, self.settings.look_ahead_m), self.settings
        evasion = draws.draw_debris_evasion(view, debris, settings.evasion, settings.driver, self.rng, settings.stay_s)
        if evasion is not None:
            self._start(sumo, evasion, time)
            self._startle(sumo, evasion, time)

    def _before_junction(self, sumo: Any, view: DriverView) -> bool:
        """Whether a junction or the end of the lane is near: a driver under command would mind neither."""
        if view.lane in self._endings(sumo) and view.lane_left_m < self.settings.junction_clear_s * view.speed:
            return True
        return view.junction_within(self.settings.junction_clear_m + self.settings.junction_clear_s * view.speed)

    def _start_maneuvers(self, sumo: Any, present: list[str], time: float) -> None:
        """Draw for every vehicle and kind of maneuver whether a command falls into this interval."""
        chances = np.array(list(self._chances.values()))
        drawn = self.rng.random((len(present), len(chances))) < chances
        for vehicle_number, kind_number in np.argwhere(drawn):
            vehicle = present[vehicle_number]
            if not self._may_be_commanded(sumo, vehicle, time):
                continue
            kind = list(self._chances)[kind_number]
            if kind == "debris":
                self._drop_debris(sumo, vehicle, time)
                continue
            maneuver = self._draw(sumo, vehicle, kind)
            if maneuver is not None:
                self._start(sumo, maneuver, time)
                self._startle(sumo, maneuver, time)

    def _drop_debris(self, sumo: Any, vehicle: str, time: float) -> None:
        view = DriverView(sumo, vehicle, self.settings.look_ahead_m)
        if self._before_junction(sumo, view):
            return
        debris = draws.draw_debris(view, self.settings.evasion, self.rng, time)
        if debris is not None:
            self._debris.append(debris)
            self._notice_s[debris, vehicle] = 0.0
            self._evade(sumo, vehicle, debris, time)

    def _draw(self, sumo: Any, vehicle: str, kind: str) -> ManeuverCommand | None:
        """A maneuver with drawn parameters, or None where the surroundings do not allow it."""
        settings, rng = self.settings, self.rng
        view = DriverView(sumo, vehicle, settings.look_ahead_m)
        if kind == "hard_brake":
            return draws.draw_brake(view, settings.hard_brake, settings.driver, rng)
        if kind == "brisk_start":
            return draws.draw_brisk_start(view, settings.brisk_start, rng)
        if self._before_junction(sumo, view):
            return None
        match kind:
            case "surge":
                reason = self._reason_to_surge(sumo, view)
                return draws.draw_surge(view, settings.hard_accel, settings.driver, rng, reason) if reason else None
            case "hard_accel":
                return draws.draw_surge(view, settings.hard_accel, settings.driver, rng, "")
            case "left_change" | "right_change":
                faster = (kind == "left_change") != self.lefthand
                direction = draws.FASTER if faster else draws.SLOWER
                return draws.draw_lane_change(view, settings.lane_change, direction, settings.stay_s)
            case "overtake":
                return draws.draw_overtake(view, settings.overtake, rng, settings.stay_s, self._active)
            case "swerve":
                return draws.draw_swerve(view, settings.swerve, settings.evasion, settings.driver, rng)
            case "slow_vehicle":
                return draws.draw_slow_vehicle(view, settings.slow_vehicle, rng)
            case "stop_in_lane":
                return draws.draw_stop_in_lane(view, settings.stop_in_lane, rng)
            case "cut_in":
                return draws.draw_cut_in(view, settings.cut_in, settings.stay_s)
        raise ValueError(f"no command is drawn for {kind}")

    def _endings(self, sumo: Any) -> list[str]:
        """The lanes that end where their road goes on."""
        if self._ending_lanes is None:
            self._ending_lanes = ending_lanes(sumo)
        return self._ending_lanes

    def _reason_to_surge(self, sumo: Any, view: DriverView) -> str:
        """What a driver would accelerate hard for: the end of its lane, or room behind the vehicle ahead."""
        if view.lane in self._endings(sumo):
            return "merge"
        return "gap_ahead" if view.leader is not None else ""

    def _close_ramps(self, sumo: Any, time: float) -> None:
        """Draw for every lane that ends whether a closure falls due; the next vehicle that can stop there does."""
        endings = self._endings(sumo)
        ramp = self.settings.closed_ramp_end
        chance = self.settings.closed_ramp_end_per_lane_hour / 3600.0 * self.decision_s
        uniform = self._ramp_rng.uniform
        for number in np.flatnonzero(self._ramp_rng.random(len(endings)) < chance):
            lane = endings[number]
            length = sumo.lane.getLength(lane)
            self._due.setdefault(lane, length - uniform(*ramp.before_end_share) * min(length, ramp.reach_m))
        closed = self._closed_lanes()
        for lane, place_m in [due for due in self._due.items() if due[0] not in closed]:
            vehicle = self._stopping_vehicle(sumo, lane, place_m, time)
            if vehicle is not None:
                del self._due[lane]
                stop, stand_s = self.settings.stop_in_lane, uniform(*ramp.stand_s)
                self._start(sumo, ClosedRampEndCommand(vehicle, lane, place_m, stand_s, ramp.patience_s, stop), time)

    def _stopping_vehicle(self, sumo: Any, lane: str, place_m: float, time: float) -> str | None:
        """A vehicle of the lane that may be commanded, can still stop at the place, and is the first to get there."""
        for vehicle in sumo.lane.getLastStepVehicleIDs(lane):
            left_m = place_m - sumo.vehicle.getLanePosition(vehicle)
            leader = sumo.vehicle.getLeader(vehicle, max(left_m, 0.0))
            clear = not leader or leader[1] > left_m
            needed_m = stopping_m(sumo.vehicle.getSpeed(vehicle), self.settings.stop_in_lane)
            if left_m > needed_m and clear and self._may_be_commanded(sumo, vehicle, time):
                return str(vehicle)
        return None

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
