"""An overtake: a car pulls out behind another vehicle, passes it, and returns ahead of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling import vehicle_control as control
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import is_parked
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate


class OvertakeCommandSettings(Settings):
    """A commanded overtake: pull out to the faster side, pass the vehicle ahead, return ahead of it."""

    headway_s: kinds.Durations = sourced(
        (0.8, 2.5), "gap to the vehicle ahead at the start, in time, s", "chosen: close enough to want to pass"
    )
    surplus_mps: kinds.Speeds = sourced(
        (5.0, 9.0), "desired speed above that of the vehicle ahead, m/s", "chosen: passing takes a few seconds"
    )
    largest_gain: float = sourced(
        1.35, "the overtaking driver's desired speed grows at most by this factor",
        "chosen: drivers are hurried, not replaced", ge=1.0, le=3.0,
    )  # fmt: skip
    speed_up_s: kinds.Duration = sourced(
        2.0, "time over which the desired speed grows, s", "chosen: no jump in acceleration"
    )
    clearance_m: kinds.Distances = sourced(
        (8.0, 22.0), "gap behind the rear at which the return begins, m", "measured: 57 of 93 completed in traffic"
    )
    pull_out_s: kinds.Duration = sourced(
        8.0, "given up when not pulled out after this time, s", "chosen: as for lane changes"
    )
    pass_s: kinds.Duration = sourced(
        25.0, "given up when not passed after this time, s", "chosen: overtakes take 10 to 20 s"
    )
    return_s: kinds.Duration = sourced(
        12.0, "given up when not returned after this time, s", "chosen: longer than pulling out"
    )


class Overtakes(DirectorSettings):
    overtake_per_vehicle_hour: float = rate("commanded overtakes", 8.0)
    overtake: OvertakeCommandSettings = OvertakeCommandSettings()


@dataclass
class OvertakeCommand(ManeuverCommand):
    """Pull out behind another vehicle, pass it, and return ahead of it.

    other: SUMO id of the vehicle to pass. speed_gain: factor on the desired speed meanwhile. clearance_m: gap between
    this vehicle's rear and the other's front at which the return begins, m. settings: the times it may take.
    """

    vehicle: str
    other: str
    speed_gain: float
    clearance_m: float
    settings: OvertakeCommandSettings
    name = "overtake"

    def __post_init__(self) -> None:
        self.steers = (self.other,)

    def steps(self, sumo: Any, step_s: float) -> Steps:
        vehicle = sumo.vehicle
        if self.other not in vehicle.getIDList() or is_parked(sumo, self.other):
            return  # it left the road in the step since it was chosen
        factor, other_factor = vehicle.getSpeedFactor(self.vehicle), vehicle.getSpeedFactor(self.other)
        vehicle.setLaneChangeMode(self.vehicle, control.COMMANDED_LANE_CHANGE_MODE)
        vehicle.setLaneChangeMode(self.other, control.COMMANDED_LANE_CHANGE_MODE)
        control.match_speed_factor(sumo, self.other)  # the one ahead keeps its speed and lane meanwhile
        try:
            if (yield from control.change_lane(sumo, self.vehicle, +1, self.settings.pull_out_s, step_s)):
                yield from self._pass_and_return(sumo, factor * self.speed_gain, step_s)
                yield from control.coast(sumo, self.vehicle, factor, step_s)
            vehicle.setLaneChangeMode(self.vehicle, control.DEFAULT_LANE_CHANGE_MODE)
        finally:  # also when this vehicle leaves the network on the way
            if self.other in vehicle.getIDList():
                vehicle.setLaneChangeMode(self.other, control.DEFAULT_LANE_CHANGE_MODE)
                vehicle.setSpeedFactor(self.other, other_factor)

    def _pass_and_return(self, sumo: Any, speed_factor: float, step_s: float) -> Steps:
        yield from control.fade_speed_factor(sumo, self.vehicle, speed_factor, self.settings.speed_up_s, step_s)
        for _ in range(round(self.settings.pass_s / step_s)):
            if self._clearance_m(sumo) > self.clearance_m:
                yield from control.change_lane(sumo, self.vehicle, -1, self.settings.return_s, step_s)
                yield from control.wait(control.SETTLE_S, step_s)
                break
            yield

    def _clearance_m(self, sumo: Any) -> float:
        """Gap from the other's front to this vehicle's rear, m; minus infinity once the other is gone."""
        if self.other not in sumo.vehicle.getIDList():
            return -np.inf
        distance = sumo.vehicle.getDrivingDistance(
            self.other, sumo.vehicle.getRoadID(self.vehicle), sumo.vehicle.getLanePosition(self.vehicle)
        )
        if distance < -1e6:  # SUMO's value for "behind it"
            return -np.inf
        return float(distance - sumo.vehicle.getLength(self.vehicle))


def draw(occasion: Occasion, settings: Overtakes) -> OvertakeCommand | None:
    """Return an overtake for a car close behind a vehicle that is not under command, with a faster lane beside."""
    view, rng, overtake = occasion.view, occasion.rng, settings.overtake
    if view.leader is None or not view.is_car or not view.has_lane(kinds.FASTER, settings.stay_s):
        return None
    gain = max(1.0, (view.leader_speed + rng.uniform(*overtake.surplus_mps)) / view.allowed_speed)
    low, high = overtake.headway_s
    close = low < view.gap_m / max(view.speed, 1.0) < high
    if not close or gain >= overtake.largest_gain or view.leader in occasion.commanded:
        return None
    return OvertakeCommand(view.vehicle, view.leader, gain, rng.uniform(*overtake.clearance_m), overtake)


KIND = Kind("overtake", draw)
