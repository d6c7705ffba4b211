"""How a driver's desired speed wanders.

SUMO's free drivers hold their desired speed exactly. People do not: the speed factor of each vehicle gets a slow random
process of its own while SUMO simulates, so that followers see it as well.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.seeding import stream
from isac_cosim.base.setting_fields import Range, range_within, sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.sway import wandering

EVERY_S = 0.5
"""Interval at which desired speeds are set, s."""
ABOVE = 1.001
"""What a desired speed is kept above the speed by while a vehicle slows, as a factor."""


class SpeedWanderSettings(Settings):
    """The desired speed of a driver over its mean: noise through two lags, as in `SwaySettings`."""

    sd_share: Annotated[Range, range_within(0.0, 0.2)] = sourced(
        (0.015, 0.03), "standard deviation of one driver's desired speed, as a share of it; 0 to 0: no wandering",
        "chosen: 1.4 to 2.9 km/h at 95 km/h",
    )  # fmt: skip
    wander_s: float = sourced(15.0, "correlation time, s", "chosen: a fraction of a minute", ge=0.1, le=600.0)
    pedal_s: float = sourced(
        4.0, "time in which the driver corrects, s", "chosen: accelerations of about 0.1 m/s²", ge=0.1, le=60.0
    )
    change_per_s: float = sourced(
        0.01,
        "largest change of the desired speed in 1 s, as a share of it",
        "chosen: 0.3 m/s² at 30 m/s",
        gt=0.0,
        le=100,
    )


@dataclass
class _Driver:
    """One driver's process from the update `first` on, where it stands, and the factor that SUMO has because of it."""

    first: int
    process: Array
    share: float = 0.0
    applied: float = 1.0


class SpeedWander:
    """Lets the desired speeds of all vehicles of a running simulation wander; one call before each step.

    The share that is added to a vehicle's speed factor follows its process, by at most `change_per_s`. Vehicles that
    somebody steers keep what they have.
    lasts_s: length of the simulation. key: names the random draws, with each vehicle's id.
    """

    def __init__(self, settings: SpeedWanderSettings, step_s: float, lasts_s: float, *key: str | int) -> None:
        self._settings = settings
        self._key = key
        self._steps_between = max(1, round(EVERY_S / step_s))
        self._interval_s = self._steps_between * step_s
        self._updates_in_all = int(np.ceil(lasts_s / self._interval_s)) + 1
        self._step = self._update = 0
        self._drivers: dict[str, _Driver] = {}

    @property
    def due(self) -> bool:
        """Whether desired speeds are set in the next step."""
        return self._settings.sd_share[1] > 0.0 and self._step % self._steps_between == 0

    def step(self, sumo: Any, steered: Collection[str]) -> None:
        """Set the desired speeds that are due. steered: the vehicles to leave alone; not looked at if none is due."""
        if self.due:
            # Only those on the road are kept, so that long simulations keep their memory.
            self._drivers = {vehicle: self._driver(vehicle) for vehicle in sumo.vehicle.getIDList()}
            for vehicle, driver in self._drivers.items():
                if vehicle not in steered:
                    self._move(sumo.vehicle, vehicle, driver)
            self._update += 1
        self._step += 1

    def _move(self, api: Any, vehicle: str, driver: _Driver) -> None:
        largest = self._settings.change_per_s * self._interval_s
        change = driver.process[self._update - driver.first] - driver.share
        driver.share += min(max(change, -largest), largest)
        factor = 1.0 + driver.share
        speed, allowed = api.getSpeed(vehicle), api.getAllowedSpeed(vehicle)
        desired = allowed * factor / driver.applied
        if desired < speed <= ABOVE * allowed:
            # A driver of SUMO above its desired speed brakes as before an obstacle: keep it above the speed, and slow.
            factor = driver.applied * ABOVE * speed / allowed
            api.slowDown(vehicle, desired, self._interval_s)
        api.setSpeedFactor(vehicle, api.getSpeedFactor(vehicle) * factor / driver.applied)
        driver.applied = factor

    def _driver(self, vehicle: str) -> _Driver:
        return self._drivers.get(vehicle) or _Driver(self._update, self._process(vehicle))

    def _process(self, vehicle: str) -> Array:
        settings, rng = self._settings, stream("speed", *self._key, vehicle)
        lags_s = settings.wander_s, settings.pedal_s
        sd = rng.uniform(*settings.sd_share)
        unit = wandering(self._updates_in_all - self._update, self._interval_s, lags_s, rng)
        # Three standard deviations are enough: no factor may become negative, however wide the settings.
        return np.asarray(sd * np.clip(unit, -3.0, 3.0))
