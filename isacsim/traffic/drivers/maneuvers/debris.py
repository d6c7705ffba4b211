"""Debris that comes into view in the lane ahead: each driver that comes near notices it at a time of its own."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris
from isac_cosim.isacsim.traffic.drivers.maneuvers.evasion import Evasion, Evasions, draw_debris_evasion
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import Kind, Occasion, rate

LEAST_NOTICE_S = 1.0
"""Debris closer than this, in time, is not evaded any more, s."""


class DebrisFalls(Evasions):
    debris_per_vehicle_hour: float = rate("debris that comes into view in the lane ahead", 20.0)


@dataclass
class Litter:
    """The debris that lies on the road, and when each driver notices it: time to collision, s."""

    lying: list[Debris] = field(default_factory=list)
    notice_s: dict[tuple[Debris, str], float] = field(default_factory=dict)

    def drop(self, debris: Debris, seen_by: str) -> None:
        """Put debris on the road that one vehicle has seen already."""
        self.lying.append(debris)
        self.notice_s[debris, seen_by] = 0.0

    def noticed(
        self,
        sumo: Any,
        time: float,
        settings: DebrisFalls,
        rng: np.random.Generator,
        commanded: Container[str],
        may_be_commanded: Callable[[str], bool],
    ) -> Iterator[tuple[str, Debris]]:
        """Yield each vehicle that notices debris now, with it. commanded: vehicles under command, which notice none."""
        self.lying = [debris for debris in self.lying if debris.until > time]
        low, high = settings.evasion.notice_ttc_s
        for debris in self.lying:
            for vehicle in sumo.lane.getLastStepVehicleIDs(debris.lane):
                gap_m, speed = debris.gap_m(sumo, vehicle), sumo.vehicle.getSpeed(vehicle)
                if not 0.0 < gap_m < high * speed or vehicle in commanded:
                    continue
                key = (debris, vehicle)
                if key not in self.notice_s:
                    self.notice_s[key] = rng.uniform(low, high)
                if gap_m < self.notice_s[key] * speed and may_be_commanded(vehicle):
                    self.notice_s[key] = 0.0
                    yield vehicle, debris


def draw_debris(view: DriverView, settings: DebrisFalls, rng: np.random.Generator, time: float) -> Debris | None:
    """Return debris that comes into a vehicle's view, behind the vehicle ahead. time: now, s."""
    evasion = settings.evasion
    if view.speed <= evasion.least_speed_mps:
        return None
    # What the vehicle ahead hides comes into view where that vehicle is now.
    ahead_m = min(rng.uniform(*evasion.notice_ttc_s) * view.speed, view.gap_m)
    ranges = evasion.debris_lateral_m, evasion.debris_half_width_m, evasion.lies_s
    lateral, half_width, lies_s = (rng.uniform(*ends) for ends in ranges)
    if ahead_m > view.lane_left_m or ahead_m < LEAST_NOTICE_S * view.speed:
        return None
    return Debris(view.lane, view.lane_position_m + ahead_m, lateral, half_width, time + ahead_m / view.speed + lies_s)


def draw(occasion: Occasion, settings: DebrisFalls) -> Evasion | None:
    """Drop debris ahead of a vehicle, and return how its driver answers."""
    debris = draw_debris(occasion.view, settings, occasion.rng, occasion.time)
    if debris is None:
        return None
    occasion.drop(debris, occasion.view.vehicle)
    return draw_debris_evasion(occasion.view, debris, settings, occasion.rng)


KIND = Kind("debris", draw)
