"""What every maneuver has in common: the contract of a kind, and of the command that drives one.

To add a maneuver, write a file with its settings, a `draw` and a command, and name it in `drivers.settings`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from isac_cosim.base.setting_fields import Range, range_within
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import DriverSettings, braking_mps2
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import Steps

Speed = Annotated[float, Field(ge=0.0, le=60.0)]
Duration = Annotated[float, Field(ge=0.0, le=600.0)]
Distance = Annotated[float, Field(ge=0.0, le=5000.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Accelerations = Annotated[Range, range_within(0.5, 10.0)]
Speeds = Annotated[Range, range_within(0.0, 40.0)]
Durations = Annotated[Range, range_within(0.0, 600.0)]
Distances = Annotated[Range, range_within(-2.0, 200.0)]
Shares = Annotated[Range, range_within(0.0, 1.0)]
Factors = Annotated[Range, range_within(0.5, 500.0)]

FASTER, SLOWER = 1, -1
"""Directions, as SUMO counts lanes: towards the faster lanes, which lie to the left where traffic keeps right and to
the right where it keeps left, and towards the slower ones. SUMO calls them left and right in either case."""
LONGEST_S = 15.0
"""What a driver does with foot and hands takes at most this long, s."""
STANDSTILL_M = 3.0
"""Distance that a driver keeps to a vehicle ahead at a standstill, m."""
EAGERNESS_PER_S = 1.5
"""How strongly a foot corrects a speed, 1/s."""
BACK_SHARE = 0.6
"""The way back from aside is meant with this share of the lateral acceleration of the way out."""
LEADER_M, LEADER_S = 100.0, 3.0
"""A steering driver minds the vehicle ahead in its lane within this distance, m, and this time gap, s."""


def rate(what: str, default: float, per: str = "vehicle's driving") -> Any:
    """Return a field that says how often something happens. per: what the hours are of."""
    return Field(default, ge=0.0, le=3600.0, description=f"{what}, per hour of {per}")


class DirectorSettings(Settings):
    """Who may be commanded, and where; and the people who drive."""

    rest_s: float = Field(12.0, ge=0.0, le=1e5, description="pause between two commands to one vehicle, s")
    within_m: float = Field(350.0, gt=0.0, le=1e5, description="only vehicles this close to a site are commanded, m")
    look_ahead_m: float = Field(
        150.0, gt=0.0, le=1000.0, description="distance within which a vehicle counts as the one ahead, m"
    )
    junction_clear_m: float = Field(
        30.0, ge=0.0, le=1000.0,
        description="nothing but a hard brake is commanded this close to a traffic light or a duty to give way, m",
    )  # fmt: skip
    junction_clear_s: float = Field(6.0, ge=0.0, le=60.0, description="added to that distance for each m/s of speed, s")
    stay_s: float = Field(
        25.0, ge=0.0, le=600.0,
        description="a vehicle is sent to a lane that misses its exit only if it can stay there this long, s",
    )  # fmt: skip
    driver: DriverSettings = DriverSettings()


class ManeuverCommand(ABC):
    """A maneuver that one vehicle is commanded to drive.

    name: stored with the recording, for provenance. vehicle: SUMO id of the vehicle that moves.
    cause: what in the traffic the driver reacts to; empty until it does, and for good where it finds no need to.
    ttc_s: time to collision when the driver began to move, s; None where there is nothing to collide with.
    steers: other vehicles whose desired speed it sets. startles: whom it surprises: the driver behind in the lane, 0,
    or behind in the next lane, `FASTER` or `SLOWER`; None: nobody.
    """

    name: str
    vehicle: str
    cause: str = ""
    ttc_s: float | None = None
    steers: tuple[str, ...] = ()
    startles: int | None = None

    @abstractmethod
    def steps(self, sumo: Any, step_s: float) -> Steps:
        """Send the commands, one simulation step at a time. sumo: the running libsumo module.

        By the end, everything that it changed on the vehicle (modes, speed factor, acceleration limit) is restored.
        """


@dataclass(frozen=True)
class Occasion:
    """A vehicle that a maneuver is drawn for.

    rng: every choice comes from it. time: now, s. lefthand: whether traffic keeps left. lane_ends: whether the
    vehicle's lane ends where its road goes on. commanded: vehicles under command. drop: puts debris on the road.
    """

    view: DriverView
    rng: np.random.Generator
    time: float
    lefthand: bool
    lane_ends: bool
    commanded: Container[str]
    drop: Callable[[Debris, str], None]


@dataclass(frozen=True)
class Kind:
    """A kind of thing that the director makes happen at a rate, the setting `<name>_per_vehicle_hour`.

    draw: returns a command with drawn parameters, or None where the surroundings do not allow it; it is given the
    `ManeuverSettings`. near_junctions: whether it may begin near a junction or the end of a lane.
    """

    name: str
    draw: Callable[[Occasion, Any], ManeuverCommand | None]
    near_junctions: bool = False

    @property
    def rate(self) -> str:
        """The setting that says how often."""
        return f"{self.name}_per_vehicle_hour"


def braking_for_leader(sumo: Any, vehicle: str, speed: float) -> float:
    """Return the deceleration that keeps a vehicle off whoever is ahead in its lane, m/s2."""
    leader = sumo.vehicle.getLeader(vehicle, LEADER_M)
    if not leader or leader[1] > LEADER_S * speed:
        return 0.0
    name, gap = leader
    leader_speed, leader_mps2 = float(sumo.vehicle.getSpeed(name)), float(sumo.vehicle.getAcceleration(name))
    return braking_mps2(float(gap), speed, leader_speed, leader_mps2, STANDSTILL_M)
