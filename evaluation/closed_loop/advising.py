"""Advisories on the road: after the network's delay and the driver's reaction, a vehicle does as it was told.

Speeds change with a limited jerk from the present acceleration, and SUMO's driver keeps its distance all the while. A
driver who reacts to something ahead, or is under command otherwise, drops the advisory at once, so that advised
vehicles meet the same hazards as all others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from isac_cosim.base.seeding import stream
from isac_cosim.evaluation.closed_loop.policy import Advisory, Instruction
from isac_cosim.evaluation.closed_loop.settings import AdvisorySettings
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import is_parked
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import (
    COMMANDED_LANE_CHANGE_MODE,
    DEFAULT_LANE_CHANGE_MODE,
    DEFAULT_SPEED_MODE,
    Steps,
    release,
    wait,
)
from isac_cosim.isacsim.traffic.sources.sumo import Moment

Fate = Literal["followed", "refused", "busy", "dropped", "gone", "pending"]
"""What became of an advisory: followed to its end; ignored by the driver; sent to a vehicle that had one already or was
under command; begun, and dropped for a reaction of the driver's own; its vehicle left; under way at the end."""


@dataclass
class Sent:
    """An advisory and what became of it. begun_s, ended_s: when the vehicle began and ceased to follow, s."""

    advisory: Advisory
    fate: Fate = "pending"
    begun_s: float | None = None
    ended_s: float | None = None


@dataclass
class Advisor:
    """Delivers advisories and carries them out, one call a simulation step.

    key: names the draws of reaction times and compliance. step_s: simulation step.
    """

    settings: AdvisorySettings
    key: tuple[str | int, ...]
    step_s: float
    sent: list[Sent] = field(default_factory=list)
    _due: list[tuple[float, Sent]] = field(default_factory=list)
    _active: dict[str, tuple[Sent, Steps]] = field(default_factory=dict)
    _rested: dict[str, float] = field(default_factory=dict)

    @property
    def under_way(self) -> dict[str, Instruction]:
        """The instruction of each vehicle that follows one, or will."""
        sent = [sent for _, sent in self._due] + [sent for sent, _ in self._active.values()]
        return {one.advisory.vehicle: one.advisory.instruction for one in sent}

    def send(self, advisory: Advisory) -> None:
        """Send an advisory; it takes effect after the network's delay and the driver's reaction time."""
        sent = Sent(advisory)
        self.sent.append(sent)
        rng = stream("advisory", *self.key, advisory.vehicle, f"{advisory.time_s:.6f}")
        follows, reaction_s = rng.random() < self.settings.compliance, rng.uniform(*self.settings.reaction_s)
        if not follows:
            sent.fate = "refused"
            return
        self._due.append((advisory.time_s + self.settings.network_delay_s + float(reaction_s), sent))

    def step(self, moment: Moment) -> None:
        """Send the commands of this step; call at every moment of the simulation."""
        if not self._due and not self._active:
            return
        sumo, present = moment.sumo, set(moment.sumo.vehicle.getIDList())
        for vehicle in list(self._active):
            if vehicle not in present or is_parked(sumo, vehicle):
                self._end(vehicle, moment.time_s, "gone")
            elif vehicle in moment.director.commanded:
                self._drop(sumo, vehicle, moment.time_s)
            else:
                self._go_on(sumo, vehicle, moment.time_s)
        due = [item for item in self._due if item[0] <= moment.time_s + 1e-9]
        self._due = [item for item in self._due if item[0] > moment.time_s + 1e-9]
        for _, sent in due:
            self._begin(moment, sent, present)
        moment.steered.update(self._active)

    def _begin(self, moment: Moment, sent: Sent, present: set[str]) -> None:
        vehicle = sent.advisory.vehicle
        if vehicle not in present or is_parked(moment.sumo, vehicle):
            sent.fate = "gone"
        elif (
            vehicle in self._active
            or self._rested.get(vehicle, 0.0) > moment.time_s
            or vehicle in moment.director.commanded
        ):
            sent.fate = "busy"
        else:
            self._active[vehicle] = sent, self._steps(moment.sumo, sent.advisory)
            sent.begun_s = moment.time_s

    def _end(self, vehicle: str, time_s: float, fate: Fate) -> None:
        sent, steps = self._active.pop(vehicle)
        steps.close()
        sent.fate, sent.ended_s = fate, time_s
        self._rested[vehicle] = time_s + self.settings.rest_s

    def _go_on(self, sumo: Any, vehicle: str, time_s: float) -> None:
        """Send the commands of this step for a vehicle that follows an advisory."""
        _, steps = self._active[vehicle]
        try:
            if next(steps, self) is self:
                self._end(vehicle, time_s, "followed")
        except _DriverBrakesError:
            self._drop(sumo, vehicle, time_s)

    def _drop(self, sumo: Any, vehicle: str, time_s: float) -> None:
        """Leave a driver alone who reacts to something ahead."""
        self._end(vehicle, time_s, "dropped")
        _let_go(sumo, vehicle)

    def _steps(self, sumo: Any, advisory: Advisory) -> Steps:
        settings = self.settings
        match advisory.instruction:
            case "hold_lane":
                return hold_lane(sumo, advisory.vehicle, settings.hold_lane_s, self.step_s)
            case "open_gap":
                return ease_off(
                    sumo, advisory.vehicle, settings.gentle_mps2, settings.open_gap_mps, settings, self.step_s
                )
            case "slow":
                peak, drop = settings.firm_mps2, settings.slow_mps
        return ease_off(sumo, advisory.vehicle, peak, drop, settings, self.step_s)


def hold_lane(sumo: Any, vehicle: str, hold_s: float, step_s: float) -> Steps:
    """Keep a driver from changing lane for a time, s. A change whose middle is across is finished."""
    sumo.vehicle.setLaneChangeMode(vehicle, COMMANDED_LANE_CHANGE_MODE)
    yield from wait(hold_s, step_s)
    sumo.vehicle.setLaneChangeMode(vehicle, DEFAULT_LANE_CHANGE_MODE)


def ease_off(
    sumo: Any, vehicle: str, peak_mps2: float, drop_mps: float, settings: AdvisorySettings, step_s: float
) -> Steps:
    """Slow a vehicle by `drop_mps` at up to `peak_mps2`, hold the lower speed for `settings.hold_s`, and let go.

    The speed is never raised. Raises _DriverBrakesError where the driver brakes for something ahead.
    """
    sumo.vehicle.setSpeedMode(vehicle, DEFAULT_SPEED_MODE)
    ask = _Asking(sumo)
    # Less than is comfortable, or it could not be told whether the driver brakes for something else.
    peak_mps2 = min(peak_mps2, 0.9 * float(sumo.vehicle.getDecel(vehicle)))
    speed = float(sumo.vehicle.getSpeed(vehicle))
    acceleration = max(float(sumo.vehicle.getAcceleration(vehicle)), -peak_mps2)
    goal = max(speed - drop_mps, settings.least_share * speed)
    change = settings.jerk_mps3 * step_s
    while speed > goal + 1e-6 or acceleration < -change:
        # The speed that is lost while the deceleration fades out again.
        fading = acceleration**2 / (2.0 * settings.jerk_mps3) if acceleration < 0.0 else 0.0
        wanted = -peak_mps2 if speed - fading > goal else 0.0
        acceleration += float(np.clip(wanted - acceleration, -change, change))
        if wanted == 0.0 and acceleration > -change:
            break
        speed = max(min(speed, float(sumo.vehicle.getSpeed(vehicle))) + acceleration * step_s, 0.0)
        ask(vehicle, speed)
        yield
    for _ in range(round(settings.hold_s / step_s)):
        speed = min(speed, float(sumo.vehicle.getSpeed(vehicle)))
        ask(vehicle, speed)
        yield
    factor = float(sumo.vehicle.getSpeedFactor(vehicle))
    try:
        yield from release(sumo, vehicle, step_s, ask)
    except _DriverBrakesError:
        sumo.vehicle.setSpeedFactor(vehicle, factor)
        raise


class _DriverBrakesError(Exception):
    """A driver brakes for something ahead, and has to be left alone."""


@dataclass
class _Asking:
    """Sets the speed of a vehicle, once a step.

    Raises _DriverBrakesError where its driver brakes as hard as SUMO lets it. While a speed is set, that is the
    comfortable deceleration, whatever is ahead; without this check (bit 2 of the speed mode) it would stop within a
    step.
    """

    sumo: Any
    asked: float = 0.0

    def __call__(self, vehicle: str, speed: float) -> None:
        vehicles = self.sumo.vehicle
        slower = vehicles.getSpeed(vehicle) < self.asked - 1e-6
        if slower and vehicles.getAcceleration(vehicle) < 0.01 - vehicles.getDecel(vehicle):
            raise _DriverBrakesError
        vehicles.setSpeed(vehicle, speed)
        self.asked = speed


def _let_go(sumo: Any, vehicle: str) -> None:
    """Give a vehicle back to its driver at once."""
    sumo.vehicle.setSpeed(vehicle, -1)
    sumo.vehicle.setLaneChangeMode(vehicle, DEFAULT_LANE_CHANGE_MODE)
