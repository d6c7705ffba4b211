"""A lane change to where nobody has to slow down; SUMO's driver waits for a safe gap and drives in its own manner."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling import vehicle_control as control
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, ManeuverCommand, Occasion, rate


class LaneChangeCommandSettings(Settings):
    """A commanded lane change to where nobody has to slow down, when SUMO finds the gaps safe."""

    clear_s: kinds.Duration = sourced(
        10.0, "only where nobody in the next lane comes closer than headway_s within this time, s; 0: anywhere",
        "chosen: as long as an overtake takes",
    )  # fmt: skip
    headway_s: kinds.Duration = sourced(1.0, "that distance as time gap, s", "chosen: most drivers keep more")
    patience_s: kinds.Duration = sourced(
        8.0, "given up when not across after this time, s", "measured: 70 of 79 done within 6 s"
    )


class LaneChanges(DirectorSettings):
    left_change_per_vehicle_hour: float = rate("commanded left lane changes", 2.0)
    right_change_per_vehicle_hour: float = rate("commanded right lane changes", 2.0)
    lane_change: LaneChangeCommandSettings = LaneChangeCommandSettings()


@dataclass
class LaneChangeCommand(ManeuverCommand):
    """Change by one lane to the faster (direction +1) or slower side (-1) within `patience_s`, if the gaps allow."""

    vehicle: str
    direction: int
    patience_s: float
    name = "lane_change"
    mode = control.COMMANDED_LANE_CHANGE_MODE

    def steps(self, sumo: Any, step_s: float) -> Steps:
        sumo.vehicle.setLaneChangeMode(self.vehicle, self.mode)
        if (yield from control.change_lane(sumo, self.vehicle, self.direction, self.patience_s, step_s)):
            yield from control.wait(control.SETTLE_S, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, control.DEFAULT_LANE_CHANGE_MODE)


def draw(left: bool, occasion: Occasion, settings: LaneChanges) -> LaneChangeCommand | None:
    """Return a lane change where there is a lane and nobody has to slow down for it; nothing is drawn."""
    view, change = occasion.view, settings.lane_change
    direction = kinds.FASTER if left != occasion.lefthand else kinds.SLOWER
    if not view.has_lane(direction, settings.stay_s):
        return None
    if change.clear_s and not view.has_room_beside(direction, change.headway_s * view.speed, change.clear_s):
        return None
    return LaneChangeCommand(view.vehicle, direction, change.patience_s)


LEFT, RIGHT = Kind("left_change", partial(draw, True)), Kind("right_change", partial(draw, False))
