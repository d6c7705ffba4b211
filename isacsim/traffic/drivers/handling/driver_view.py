"""What the director looks up in SUMO before it commands a vehicle: lanes, gaps, the distance to a junction."""

from __future__ import annotations

from typing import Any

import numpy as np

PARKED = 2
"""The flag of SUMO's stop states for vehicles beside the road."""
CAR = "passenger"
"""SUMO's vehicle class of cars."""
STEADY_M, STEADY_MPS = 0.5, 0.1
"""A vehicle this close to the middle of its lane, and this slow across it, is not changing lanes."""
FOLLOWER_M = 100.0
"""Distance within which a vehicle counts as the one behind, m."""
STANDS_MPS = 0.5
"""Below this speed a vehicle stands, m/s."""


class DriverView:
    """One vehicle and what is around it, as SUMO reports it now.

    sumo: the running libsumo module. look_ahead_m: distance within which a leader counts, m.
    leader: SUMO id of the vehicle ahead in the lane, or None. gap_m: to it, m; infinite without one. speed: m/s.
    """

    def __init__(self, sumo: Any, vehicle: str, look_ahead_m: float) -> None:
        self._sumo = sumo
        self.vehicle = vehicle
        self.speed = float(sumo.vehicle.getSpeed(vehicle))
        leader = sumo.vehicle.getLeader(vehicle, look_ahead_m)
        self.leader: str | None = leader[0] if leader else None
        self.gap_m = float(leader[1]) if leader else np.inf

    @property
    def leader_speed(self) -> float:
        """Speed of the vehicle ahead, m/s; infinite without one."""
        return float(self._sumo.vehicle.getSpeed(self.leader)) if self.leader else np.inf

    @property
    def allowed_speed(self) -> float:
        """Speed that the driver wants on this lane, m/s."""
        return float(self._sumo.vehicle.getAllowedSpeed(self.vehicle))

    @property
    def is_car(self) -> bool:
        """Whether the vehicle is of SUMO's class for cars."""
        return bool(self._sumo.vehicle.getVehicleClass(self.vehicle) == CAR)

    @property
    def lane_width_m(self) -> float:
        """Width of the lane that the vehicle is in, m."""
        return float(self._sumo.lane.getWidth(self.lane))

    @property
    def width_m(self) -> float:
        """Width of the vehicle, m."""
        return float(self._sumo.vehicle.getWidth(self.vehicle))

    @property
    def lateral_m(self) -> float:
        """Offset of the vehicle from its lane's middle, positive to the faster side, m."""
        return float(self._sumo.vehicle.getLateralLanePosition(self.vehicle))

    @property
    def is_steady(self) -> bool:
        """Whether the vehicle drives in the middle of its lane and does not move across it."""
        return abs(self.lateral_m) < STEADY_M and abs(self._sumo.vehicle.getLateralSpeed(self.vehicle)) < STEADY_MPS

    @property
    def lane(self) -> str:
        """SUMO id of the lane that the vehicle is in."""
        return str(self._sumo.vehicle.getLaneID(self.vehicle))

    @property
    def lane_position_m(self) -> float:
        """Position of the front bumper along the lane, m."""
        return float(self._sumo.vehicle.getLanePosition(self.vehicle))

    @property
    def lane_left_m(self) -> float:
        """Length of the lane ahead of the vehicle, m."""
        return float(self._sumo.lane.getLength(self.lane)) - self.lane_position_m

    def has_room_beside(self, direction: int, clear_m: float, ahead_s: float) -> bool:
        """Return whether a vehicle can move over: nobody beside within clear_m, also not after ahead_s at these speeds.

        direction: +1 towards the faster lanes, -1 towards the slower ones.
        """
        get = self._sumo.vehicle
        behind = get.getLeftFollowers if direction > 0 else get.getRightFollowers
        ahead = get.getLeftLeaders if direction > 0 else get.getRightLeaders
        closing = [(gap, get.getSpeed(name) - self.speed) for name, gap in behind(self.vehicle)]
        closing += [(gap, self.speed - get.getSpeed(name)) for name, gap in ahead(self.vehicle)]
        return all(gap - max(0.0, rate) * ahead_s > clear_m for gap, rate in closing)

    def follower(self) -> tuple[str, float] | None:
        """Return the vehicle behind in the lane and its gap, m, or None."""
        name, gap = self._sumo.vehicle.getFollower(self.vehicle, FOLLOWER_M)
        return (str(name), float(gap)) if name else None

    def follower_beside(self, direction: int) -> tuple[str, float] | None:
        """Return the nearest vehicle behind in the lane on a side and its gap, m, or None. direction: as below."""
        get = self._sumo.vehicle
        behind = (get.getLeftFollowers if direction > 0 else get.getRightFollowers)(self.vehicle)
        return min(((str(name), float(gap)) for name, gap in behind), key=lambda pair: pair[1], default=None)

    def stands_at_light(self, distance_m: float) -> bool:
        """Whether the vehicle stands within a distance of a traffic light."""
        lights = self._sumo.vehicle.getNextTLS(self.vehicle)
        return self.speed < STANDS_MPS and any(distance < distance_m for _, _, distance, _ in lights)

    def junction_within(self, distance_m: float) -> bool:
        """Whether a traffic light or a duty to give way lies within a distance: a commanded vehicle ignores both."""
        sumo, vehicle = self._sumo, self.vehicle
        if any(distance < distance_m for _, _, distance, _ in sumo.vehicle.getNextTLS(vehicle)):
            return True
        lane = sumo.vehicle.getLaneID(vehicle)
        left_m = sumo.lane.getLength(lane) - sumo.vehicle.getLanePosition(vehicle)
        yields = any(not has_priority for _, has_priority, *_ in sumo.lane.getLinks(lane))
        in_junction = sumo.vehicle.getRoadID(vehicle).startswith(":")
        return bool(in_junction or (yields and left_m < distance_m))

    def has_lane(self, direction: int, stay_s: float) -> bool:
        """Whether there is a lane on a side that the vehicle may use without missing its exit.

        direction: +1 towards the faster lanes, -1 towards the slower ones.
        A lane that does not lead to the exit counts if the vehicle can stay on it for stay_s at its present speed.
        """
        sumo, vehicle = self._sumo, self.vehicle
        target = sumo.vehicle.getLaneIndex(vehicle) + direction
        edge = sumo.vehicle.getRoadID(vehicle)
        if edge.startswith(":") or not 0 <= target < sumo.edge.getLaneNumber(edge):
            return False
        # SUMO counts a lane's length from where the edge begins.
        needed_m = sumo.vehicle.getLanePosition(vehicle) + stay_s * self.speed
        lane = f"{edge}_{target}"
        leads_on = any(
            name == lane and (offset == 0 or length > needed_m)
            for name, length, _, offset, *_ in sumo.vehicle.getBestLanes(vehicle)
        )
        return leads_on and open_to(sumo, lane, sumo.vehicle.getVehicleClass(vehicle))

    def gap_beside_m(self, direction: int) -> float:
        """The smaller of the gaps to the next vehicles ahead and behind in the lane on a side, m.

        direction: +1 towards the faster lanes, -1 towards the slower ones. What SUMO calls left is the faster side.
        """
        get = self._sumo.vehicle
        followers = get.getLeftFollowers if direction > 0 else get.getRightFollowers
        leaders = get.getLeftLeaders if direction > 0 else get.getRightLeaders
        gaps = (gap for _, gap in (*followers(self.vehicle), *leaders(self.vehicle)))
        return float(min(gaps, default=np.inf))


def is_parked(sumo: Any, vehicle: str) -> bool:
    """Return whether a vehicle stands beside the road, where it is in no lane."""
    return bool(sumo.vehicle.getStopState(vehicle) & PARKED)


def ending_lanes(sumo: Any) -> list[str]:
    """Lanes for cars that end where their road goes on: no link leaves them, but one leaves a lane beside them."""
    lanes = [lane for lane in sumo.lane.getIDList() if not lane.startswith(":") and open_to(sumo, lane, CAR)]
    linked = {lane for lane in lanes if sumo.lane.getLinks(lane)}
    continued_edges = {sumo.lane.getEdgeID(lane) for lane in linked}
    return [lane for lane in lanes if lane not in linked and sumo.lane.getEdgeID(lane) in continued_edges]


def open_to(sumo: Any, lane: str, vehicle_class: str) -> bool:
    """Whether vehicles of a class may use a lane."""
    allowed = sumo.lane.getAllowed(lane)
    return not allowed or vehicle_class in allowed
