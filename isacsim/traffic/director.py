"""Stimulated traffic: which vehicles are commanded to do what, and when.

Hard events are rare in settled traffic. The director picks vehicles at random and gives them commanded maneuvers
(`isacsim.traffic.maneuvers`) and disturbances that others react to by themselves. It knows nothing of labels: whether
what it commanded became an event is for the detectors to see in the recording.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import Field

from isacsim.scenarios.scenario import Site
from isacsim.settings import Settings
from isacsim.traffic.maneuvers import (
    ClosedRampEnd,
    CutIn,
    HardAccel,
    HardBrake,
    LaneChange,
    Maneuver,
    Overtake,
    SlowVehicle,
    Steps,
    StopInLane,
    Swerve,
    stopping_m,
)
from isacsim.traffic.recording import Command

RETURN_S = 25.0
"""A lane that misses a vehicle's exit is given to it only if it can stay there for so long, s."""


def _rate(what: str, default: float) -> Any:
    return Field(default, ge=0.0, le=3600.0, description=f"{what}, per hour of a vehicle's driving")


class ManeuverSettings(Settings):
    """Rates at which maneuvers are asked for, per vehicle-hour or per lane-hour; all zero leaves the traffic alone.

    A maneuver that the surroundings do not allow (no gap ahead to accelerate into, no lane to change to) is not
    started, so fewer happen than are asked for.
    """

    hard_brake_per_vehicle_hour: float = _rate("commanded hard brakes", 5.0)
    hard_accel_per_vehicle_hour: float = _rate("commanded hard accelerations", 25.0)
    left_change_per_vehicle_hour: float = _rate("commanded left lane changes", 2.0)
    right_change_per_vehicle_hour: float = _rate("commanded right lane changes", 2.0)
    overtake_per_vehicle_hour: float = _rate("commanded overtakes", 8.0)
    swerve_per_vehicle_hour: float = _rate("commanded evasive swerves", 15.0)
    slow_vehicle_per_vehicle_hour: float = _rate("vehicles that slow down for others to react to", 1.0)
    stop_in_lane_per_vehicle_hour: float = _rate("vehicles that stop in their lane", 0.1)
    cut_in_per_vehicle_hour: float = _rate("lane changes close in front of another", 2.0)
    closed_ramp_end_per_lane_hour: float = Field(
        6.0,
        ge=0.0,
        le=3600.0,
        description="vehicles that stop near the end of a lane that ends, so that others have to merge before; "
        "per hour of each such lane",
    )
    rest_s: float = Field(12.0, ge=0.0, description="pause between two commands to one vehicle, s")
    within_m: float = Field(350.0, gt=0.0, description="only vehicles this near to a site are commanded, m")

    @property
    def quiet(self) -> bool:
        """Whether nothing is ever commanded."""
        return not any(getattr(self, name) for name in type(self).model_fields if name.endswith("_hour"))


@dataclass
class _Active:
    maneuver: Maneuver
    steps: Steps
    start: float


@dataclass
class Director:
    """Starts maneuvers and keeps them going, one call a simulation step.

    sites: in SUMO's coordinates. rng: every choice comes from it.
    """

    settings: ManeuverSettings
    sites: Iterable[Site]
    origin: tuple[float, float]
    rng: np.random.Generator
    step_s: float
    decision_s: float = 0.1
    commands: list[Command] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._where = np.array([(site.x, site.y) for site in self.sites]).reshape(-1, 2) + self.origin
        self._active: dict[str, _Active] = {}
        self._rested: dict[str, float] = {}
        self._every = round(self.decision_s / self.step_s)
        self._step = 0
        self._ends: list[str] | None = None
        self._due: dict[str, float] = {}
        # Of its own, so that places have no say in what is drawn for vehicles.
        self._places = self.rng.spawn(1)[0]
        self._choices = {
            name.removesuffix("_per_vehicle_hour"): getattr(self.settings, name) / 3600.0 * self.decision_s
            for name in ManeuverSettings.model_fields
            if name.endswith("_per_vehicle_hour")
        }

    def step(self, sumo: Any, time: float) -> None:
        """Send the commands of this step; time: s. To be called before each simulation step."""
        present = set(sumo.vehicle.getIDList())
        for vehicle, active in list(self._active.items()):
            if vehicle not in present:
                active.steps.close()
                self._finish(vehicle, time)
            elif next(active.steps, self) is self:
                self._finish(vehicle, time)
        if self._step % self._every == 0 and not self.settings.quiet:
            self._start(sumo, sorted(present), time)
            if self.settings.closed_ramp_end_per_lane_hour > 0.0:
                self._close(sumo, time)
        self._step += 1

    def finish(self, time: float) -> None:
        """Close what is still going when the simulation ends, while SUMO still answers."""
        for vehicle, active in list(self._active.items()):
            active.steps.close()
            self._finish(vehicle, time)

    def _finish(self, vehicle: str, time: float) -> None:
        done = self._active.pop(vehicle)
        self.commands.append(Command(vehicle, done.maneuver.name, done.start, time))
        self._rested[vehicle] = time + self.settings.rest_s

    def _start(self, sumo: Any, present: list[str], time: float) -> None:
        """Draw for every vehicle and kind at once whether a command falls into this interval."""
        chances = np.array(list(self._choices.values()))
        drawn = self.rng.random((len(present), len(chances))) < chances
        for vehicle_number, kind_number in np.argwhere(drawn):
            vehicle = present[vehicle_number]
            if not self._free(sumo, vehicle, time):
                continue
            maneuver = self._compose(sumo, vehicle, list(self._choices)[kind_number])
            if maneuver is not None:
                self._active[vehicle] = _Active(maneuver, maneuver.steps(sumo, self.step_s), time)

    def _close(self, sumo: Any, time: float) -> None:
        """Draw for every lane that ends whether a closure falls due; the next vehicle that can stop there does."""
        if self._ends is None:
            self._ends = ending_lanes(sumo)
        chance = self.settings.closed_ramp_end_per_lane_hour / 3600.0 * self.decision_s
        draw = self._places.uniform
        for number in np.flatnonzero(self._places.random(len(self._ends)) < chance):
            length = sumo.lane.getLength(self._ends[number])
            self._due.setdefault(self._ends[number], length - draw(0.05, 0.5) * min(length, 250.0))
        closed = self._closed_lanes()
        for lane, place in [each for each in self._due.items() if each[0] not in closed]:
            vehicle = self._stops_at(sumo, lane, place, time)
            if vehicle is not None:
                del self._due[lane]
                maneuver = ClosedRampEnd(vehicle, lane, place, draw(20.0, 60.0), 30.0)
                self._active[vehicle] = _Active(maneuver, maneuver.steps(sumo, self.step_s), time)

    def _stops_at(self, sumo: Any, lane: str, place_m: float, time: float) -> str | None:
        """A vehicle of the lane that may be commanded, can still stop at the place, and has nobody before it there."""
        for vehicle in sumo.lane.getLastStepVehicleIDs(lane):
            left_m = place_m - sumo.vehicle.getLanePosition(vehicle)
            leader = sumo.vehicle.getLeader(vehicle, max(left_m, 0.0))
            clear = not leader or leader[1] > left_m
            if left_m > stopping_m(sumo.vehicle.getSpeed(vehicle)) and clear and self._free(sumo, vehicle, time):
                return str(vehicle)
        return None

    def _closed_lanes(self) -> set[str]:
        return {each.maneuver.lane for each in self._active.values() if isinstance(each.maneuver, ClosedRampEnd)}

    def _free(self, sumo: Any, vehicle: str, time: float) -> bool:
        """Whether a vehicle may be commanded: not under command, rested, near to a site, and not beside a closed lane.

        What happens beside a closed lane is the drivers' own: a commanded one would be blind to those that merge.
        """
        if vehicle in self._active or self._rested.get(vehicle, 0.0) > time or not self._sensed(sumo, vehicle):
            return False
        beside = {sumo.lane.getEdgeID(lane) for lane in self._closed_lanes()}
        return sumo.vehicle.getRoadID(vehicle) not in beside

    def _sensed(self, sumo: Any, vehicle: str) -> bool:
        position = np.array(sumo.vehicle.getPosition(vehicle))
        return bool((np.hypot(*(self._where - position).T) < self.settings.within_m).any())

    def _compose(self, sumo: Any, vehicle: str, kind: str) -> Maneuver | None:
        """A maneuver with drawn parameters, or none where the surroundings do not allow it."""
        draw = self.rng.uniform
        speed = sumo.vehicle.getSpeed(vehicle)
        if kind != "hard_brake" and self._junction_ahead(sumo, vehicle, 30.0 + 6.0 * speed):
            return None
        leader = sumo.vehicle.getLeader(vehicle, 150.0)
        room = leader[1] if leader else np.inf
        if kind == "hard_brake" and speed > 14.0:
            return HardBrake(vehicle, -draw(4.8, 8.0), draw(10.0, 18.0), draw(0.6, 1.6), draw(6.0, 12.0))
        if kind == "hard_accel" and speed > 5.0 and room > 20.0 + 1.2 * speed and self._is_car(sumo, vehicle):
            peak = draw(3.0, 4.5) if speed < 25.0 else draw(2.8, 3.5)
            ahead = sumo.vehicle.getSpeed(leader[0]) if leader else np.inf
            # What is left of the gap has to do for the driver to close in without braking hard.
            top = max(speed + 1.7 * peak, min(44.0, ahead + 0.05 * (room - 1.2 * speed)))
            return HardAccel(vehicle, peak, draw(5.0, 10.0), draw(1.4, 2.6), draw(4.0, 8.0), top)
        if kind in ("left_change", "right_change"):
            direction = 1 if kind == "left_change" else -1
            if self._has_lane(sumo, vehicle, direction):
                return LaneChange(vehicle, direction, 8.0)
        if kind == "overtake" and leader and self._is_car(sumo, vehicle) and self._has_lane(sumo, vehicle, 1):
            allowed = sumo.vehicle.getAllowedSpeed(vehicle)
            gain = max(1.0, (sumo.vehicle.getSpeed(leader[0]) + draw(5.0, 9.0)) / allowed)
            if 0.8 < room / max(speed, 1.0) < 2.5 and gain < 1.35 and leader[0] not in self._active:
                return Overtake(vehicle, leader[0], gain, draw(8.0, 22.0), 25.0)
        # A swerve evades something: without a vehicle ahead there is nothing to evade.
        if kind == "swerve" and self._is_car(sumo, vehicle) and speed > 10.0 and room < 90.0:
            sides = [side for side in (1, -1) if self._beside_free(sumo, vehicle, side)]
            if sides:
                half = sumo.lane.getWidth(sumo.vehicle.getLaneID(vehicle)) / 2.0
                offset = draw(1.0, min(1.7, half - 0.1))
                return Swerve(vehicle, float(self.rng.choice(sides)) * offset, draw(4.5, 6.0), draw(0.0, 0.6))
        if kind == "slow_vehicle" and speed > 15.0:
            return SlowVehicle(vehicle, draw(0.65, 0.8), draw(20.0, 40.0))
        if kind == "stop_in_lane":
            return StopInLane(vehicle, draw(15.0, 40.0))
        if kind == "cut_in" and speed > 8.0:
            sides = [side for side in (1, -1) if self._has_lane(sumo, vehicle, side)]
            sides = [side for side in sides if 6.0 < self._room_beside(sumo, vehicle, side) < 20.0]
            if sides:
                return CutIn(vehicle, sides[0])
        return None

    @staticmethod
    def _junction_ahead(sumo: Any, vehicle: str, within_m: float) -> bool:
        """Whether a signal or a duty to give way is within a distance: what is commanded ignores both."""
        if any(distance < within_m for _, _, distance, _ in sumo.vehicle.getNextTLS(vehicle)):
            return True
        edge = sumo.vehicle.getRoadID(vehicle)
        left_m = sumo.lane.getLength(sumo.vehicle.getLaneID(vehicle)) - sumo.vehicle.getLanePosition(vehicle)
        yields = any(not has_priority for _, has_priority, *_ in sumo.lane.getLinks(sumo.vehicle.getLaneID(vehicle)))
        return bool(edge.startswith(":") or (yields and left_m < within_m))

    @staticmethod
    def _is_car(sumo: Any, vehicle: str) -> bool:
        return bool(sumo.vehicle.getVehicleClass(vehicle) == "passenger")

    @staticmethod
    def _has_lane(sumo: Any, vehicle: str, direction: int) -> bool:
        """Whether there is a lane on that side that the vehicle may use and that does not take it past its exit."""
        target = sumo.vehicle.getLaneIndex(vehicle) + direction
        edge = sumo.vehicle.getRoadID(vehicle)
        if edge.startswith(":") or not 0 <= target < sumo.edge.getLaneNumber(edge):
            return False
        # SUMO counts a lane's length from where the edge begins.
        needed_m = sumo.vehicle.getLanePosition(vehicle) + RETURN_S * sumo.vehicle.getSpeed(vehicle)
        lane = f"{edge}_{target}"
        leads_on = any(
            name == lane and (offset == 0 or length > needed_m)
            for name, length, _, offset, *_ in sumo.vehicle.getBestLanes(vehicle)
        )
        return leads_on and open_to(sumo, lane, sumo.vehicle.getVehicleClass(vehicle))

    def _beside_free(self, sumo: Any, vehicle: str, side: int) -> bool:
        """Whether no vehicle on the neighbouring lane is within 15 m ahead or behind."""
        return self._room_beside(sumo, vehicle, side) > 15.0

    @staticmethod
    def _room_beside(sumo: Any, vehicle: str, side: int) -> float:
        """The smaller of the gaps to the neighbouring lane's next vehicles ahead and behind, m."""
        followers = sumo.vehicle.getLeftFollowers if side > 0 else sumo.vehicle.getRightFollowers
        leaders = sumo.vehicle.getLeftLeaders if side > 0 else sumo.vehicle.getRightLeaders
        return float(min((gap for _, gap in (*followers(vehicle), *leaders(vehicle))), default=np.inf))


def ending_lanes(sumo: Any) -> list[str]:
    """Lanes for cars that end where their road goes on: no link leaves them, but one leaves a lane beside them."""
    lanes = [lane for lane in sumo.lane.getIDList() if not lane.startswith(":") and open_to(sumo, lane, "passenger")]
    linked = {lane for lane in lanes if sumo.lane.getLinks(lane)}
    going_on = {sumo.lane.getEdgeID(lane) for lane in linked}
    return [lane for lane in lanes if lane not in linked and sumo.lane.getEdgeID(lane) in going_on]


def open_to(sumo: Any, lane: str, vehicle_class: str) -> bool:
    """Whether vehicles of a class may use a lane."""
    allowed = sumo.lane.getAllowed(lane)
    return not allowed or vehicle_class in allowed
