"""A disturbance: a vehicle stops before the end of a lane that ends, and those behind have to merge earlier."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling import vehicle_control as control
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import ManeuverCommand, rate
from isac_cosim.isacsim.traffic.drivers.maneuvers.stop_in_lane import (
    StopInLaneCommand,
    StopInLaneCommandSettings,
    StopsInLane,
    stopping_m,
)


class ClosedRampEndCommandSettings(Settings):
    """A disturbance: a vehicle stops, as `StopInLaneCommandSettings` says, before the end of a lane that ends."""

    before_end_share: kinds.Shares = sourced(
        (0.05, 0.5), "where it stops: distance to the lane's end, as a share of reach_m",
        "chosen: an end that is closed early",
    )  # fmt: skip
    reach_m: kinds.Distance = sourced(
        250.0, "length of the lane's last part, or the lane if shorter, m", "chosen: a usual ramp"
    )
    stand_s: kinds.Durations = sourced(
        (20.0, 60.0), "time at a standstill, s", "chosen: several vehicles have to merge before it"
    )
    patience_s: kinds.Duration = sourced(
        30.0, "given up when not braking after this time, s", "chosen: a ramp is driven in less"
    )


class ClosedRampEnds(StopsInLane):
    closed_ramp_end_per_lane_hour: float = rate(
        "vehicles that stop near the end of a lane that ends, so that others have to merge before", 6.0, "such a lane"
    )
    closed_ramp_end: ClosedRampEndCommandSettings = ClosedRampEndCommandSettings()


@dataclass
class ClosedRampEndCommand(ManeuverCommand):
    """Keep to a lane that ends, stop before its end, stand, and drive on: vehicles behind have to merge earlier.

    lane: the lane that the vehicle is in. place_m: where its front bumper stops, from the lane's beginning, m. No
    vehicle may be between it and the place. stand_s: time at a standstill, s. patience_s: given up if the vehicle has
    not begun to brake by then, s. stop: how it stops.
    """

    vehicle: str
    lane: str
    place_m: float
    stand_s: float
    patience_s: float
    stop: StopInLaneCommandSettings
    name = "closed_ramp_end"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, control.COMMANDED_LANE_CHANGE_MODE)
        for _ in range(round(self.patience_s / step_s)):
            if self.reached(sumo) or sumo.vehicle.getLaneID(self.vehicle) != self.lane:
                break
            yield
        if self.reached(sumo):
            yield from StopInLaneCommand(self.vehicle, self.stand_s, self.stop).steps(sumo, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, control.DEFAULT_LANE_CHANGE_MODE)

    def reached(self, sumo: Any) -> bool:
        """Whether the vehicle, in its lane, is as close to the place as stopping takes, or closer."""
        left_m = self.place_m - sumo.vehicle.getLanePosition(self.vehicle)
        in_lane = sumo.vehicle.getLaneID(self.vehicle) == self.lane
        return bool(in_lane and left_m <= stopping_m(sumo.vehicle.getSpeed(self.vehicle), self.stop))


@dataclass
class Closures:
    """Draws which lane's end is closed, and where. rng: of its own, so that what is drawn for vehicles stays the same.

    due: places at which the next vehicle that can will stop, by lane, m from the lane's beginning.
    """

    settings: ClosedRampEnds
    rng: np.random.Generator
    due: dict[str, float] = field(default_factory=dict)

    def commands(
        self,
        sumo: Any,
        endings: Sequence[str],
        interval_s: float,
        closed: Container[str],
        may_be_commanded: Callable[[str], bool],
    ) -> Iterator[ClosedRampEndCommand]:
        """Draw for every lane that ends whether a closure falls due; yield the command to each vehicle that stops now.

        endings: the lanes that end. interval_s: since the last call. closed: lanes that are closed already.
        """
        ramp = self.settings.closed_ramp_end
        chance = self.settings.closed_ramp_end_per_lane_hour / 3600.0 * interval_s
        for number in np.flatnonzero(self.rng.random(len(endings)) < chance).tolist():
            lane = endings[number]
            length = sumo.lane.getLength(lane)
            self.due.setdefault(lane, length - self.rng.uniform(*ramp.before_end_share) * min(length, ramp.reach_m))
        for lane, place_m in [due for due in self.due.items() if due[0] not in closed]:
            vehicle = self._stopping_vehicle(sumo, lane, place_m, may_be_commanded)
            if vehicle is not None:
                del self.due[lane]
                stop, stand_s = self.settings.stop_in_lane, self.rng.uniform(*ramp.stand_s)
                yield ClosedRampEndCommand(vehicle, lane, place_m, stand_s, ramp.patience_s, stop)

    def _stopping_vehicle(
        self, sumo: Any, lane: str, place_m: float, may_be_commanded: Callable[[str], bool]
    ) -> str | None:
        """A vehicle of the lane that may be commanded, can still stop at the place, and is the first to get there."""
        for vehicle in sumo.lane.getLastStepVehicleIDs(lane):
            left_m = place_m - sumo.vehicle.getLanePosition(vehicle)
            leader = sumo.vehicle.getLeader(vehicle, max(left_m, 0.0))
            clear = not leader or leader[1] > left_m
            needed_m = stopping_m(sumo.vehicle.getSpeed(vehicle), self.settings.stop_in_lane)
            if left_m > needed_m and clear and may_be_commanded(vehicle):
                return str(vehicle)
        return None
