"""The maneuvers of this project: all settings of `[dataset.maneuvers]`, the kinds that are drawn, and named worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from isac_cosim.isacsim.traffic.drivers.maneuvers import (
    brisk_start,
    cut_in,
    debris,
    hard_accel,
    hard_brake,
    lane_change,
    overtake,
    slow_vehicle,
    stop_in_lane,
    swerve,
)
from isac_cosim.isacsim.traffic.drivers.maneuvers.closed_ramp_end import ClosedRampEnds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import Kind

KINDS: tuple[Kind, ...] = (
    debris.KIND,
    hard_accel.SURGE,
    brisk_start.KIND,
    hard_brake.KIND,
    hard_accel.KIND,
    lane_change.LEFT,
    lane_change.RIGHT,
    overtake.KIND,
    swerve.KIND,
    slow_vehicle.KIND,
    stop_in_lane.KIND,
    cut_in.KIND,
)
"""What is drawn for vehicles. The order is part of what a seed means: append, never insert."""


class ManeuverSettings(
    ClosedRampEnds,
    cut_in.CutIns,
    slow_vehicle.SlowVehicles,
    swerve.Swerves,
    overtake.Overtakes,
    lane_change.LaneChanges,
    hard_brake.HardBrakes,
    brisk_start.BriskStarts,
    hard_accel.HardAccels,
    debris.DebrisFalls,
):
    """How often what happens, to whom, and what it is like. All rates zero: traffic is left alone.

    A cause or command is skipped where the surroundings do not allow it (no room to accelerate into, no lane to change
    to), so fewer happen than the rates say.
    """

    @property
    def quiet(self) -> bool:
        """Whether nothing is ever commanded."""
        return not any(getattr(self, name) for name in LEFT_ALONE)


LEFT_ALONE = {name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")}
"""The rates of `ManeuverSettings` with which drivers are left alone."""
NATURAL = "natural-1"
WORLDS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {"stimulated-2": {}, NATURAL: {"maneuvers": LEFT_ALONE}}
"""Named worlds: by section, what differs from the defaults. Another value of any setting needs another name."""
