"""A disturbance: a lane change close in front of a vehicle, which has to brake."""

from __future__ import annotations

from dataclasses import dataclass

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import FORCED_LANE_CHANGE_MODE
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, Kind, Occasion, rate
from isac_cosim.isacsim.traffic.drivers.maneuvers.lane_change import LaneChangeCommand


class CutInCommandSettings(Settings):
    """A disturbance: a lane change close in front of a vehicle, which has to brake."""

    least_speed_mps: kinds.Speed = sourced(8.0, "only faster vehicles cut in, m/s", "chosen: no queues")
    gap_m: kinds.Distances = sourced(
        (6.0, 20.0), "smaller of the gaps ahead and behind in the next lane, m", "chosen: tight, but no collision"
    )
    patience_s: kinds.Duration = sourced(
        5.0, "given up when not across after this time, s", "chosen: the gap does not stay"
    )


class CutIns(DirectorSettings):
    cut_in_per_vehicle_hour: float = rate("lane changes close in front of another vehicle", 6.0)
    cut_in: CutInCommandSettings = CutInCommandSettings()


@dataclass
class CutInCommand(LaneChangeCommand):
    """Change lanes without waiting for a gap, close in front of a vehicle there, which has to brake."""

    name = "cut_in"
    mode = FORCED_LANE_CHANGE_MODE

    def __post_init__(self) -> None:
        self.startles = self.direction


def draw(occasion: Occasion, settings: CutIns) -> CutInCommand | None:
    """Return a cut-in, to the faster side where the gap there fits, otherwise to the slower; nothing is drawn."""
    view, cut_in = occasion.view, settings.cut_in
    if view.speed <= cut_in.least_speed_mps:
        return None
    low, high = cut_in.gap_m
    for side in (kinds.FASTER, kinds.SLOWER):
        if view.has_lane(side, settings.stay_s) and low < view.gap_beside_m(side) < high:
            return CutInCommand(view.vehicle, side, cut_in.patience_s)
    return None


KIND = Kind("cut_in", draw)
