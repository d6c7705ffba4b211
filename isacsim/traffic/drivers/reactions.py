"""Maneuvers that a driver drives: evading something, accelerating into room, and the same without a cause.

A reaction begins with the cause: the driver notices it after the reaction time, and only then moves foot or hands. What
the motion becomes follows from the driver model (`driver_model`) and from what is ahead meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isac_cosim.isacsim.traffic.drivers.command_settings import BriskStartSettings
from isac_cosim.isacsim.traffic.drivers.controls import MODE_S, Foot, Hands, pedal_limit
from isac_cosim.isacsim.traffic.drivers.driver_model import Driver, braking_mps2
from isac_cosim.isacsim.traffic.drivers.hazards import Debris, Hazard, time_to_collision_s
from isac_cosim.isacsim.traffic.drivers.vehicle_control import DEFAULT_LANE_CHANGE_MODE, Steps, release, wait

CALM_TTC_S, CALM_MPS2 = 6.0, 1.5
"""A driver with more time to collision than this, and no need to brake harder than this, does not react."""
PATIENCE_S = 4.0
"""A hazard that is expected shows within this time, s, or not at all."""
LONGEST_S = 15.0
"""A reaction takes at most this long, s."""
STANDSTILL_M = 3.0
"""Distance that a driver keeps to a vehicle ahead at a standstill, m."""
EAGERNESS_PER_S = 1.5
"""How strongly a foot corrects a speed, 1/s."""
STEERING_MPS2 = (2.0, 7.0)
"""Bounds of the lateral acceleration that a driver means in an emergency, m/s2."""
BACK_SHARE = 0.6
"""The way back is meant with this share of the lateral acceleration of the way out."""
LEADER_M, LEADER_S = 100.0, 3.0
"""An evading driver minds the vehicle ahead in its lane within this distance, m, and this time gap, s."""
CLOSING_MPS2 = 1.5
"""An accelerating driver eases off where closing in on the vehicle ahead would take a stronger deceleration, m/s2."""
STARTS_MPS = 0.3
"""A vehicle that stood has started at this speed, m/s."""


@dataclass
class Reaction:
    """A maneuver with a cause.

    cause: its name; empty until the driver reacts, and for good where the driver finds no need to.
    ttc_s: time to collision when the driver began to move, s; None where there is nothing to collide with.
    """

    cause: str = field(default="", init=False)
    ttc_s: float | None = field(default=None, init=False)


@dataclass(frozen=True)
class EvasionPlan:
    """How a driver evades: braking, moving aside, or both.

    brakes: whether to brake. aside_m: how far to move aside, positive to the faster side; 0: not at all. stays:
    whether to stay there, in the next lane. steer_ttc_s: with more time to collision, the driver only brakes, s.
    pass_share: speed at which to pass debris, as a share of the present one.
    """

    brakes: bool
    aside_m: float = 0.0
    stays: bool = False
    steer_ttc_s: float = np.inf
    pass_share: float = 1.0


@dataclass
class Evasion(Reaction):
    """Evade a hazard.

    inattentive: the driver looks away at first, and the vehicle rolls on. A hazard that does not show within
    `PATIENCE_S` is not reacted to.
    """

    vehicle: str
    hazard: Hazard
    plan: EvasionPlan
    driver: Driver
    rng: np.random.Generator
    inattentive: bool
    name: str = "evasion"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        hands = Hands(sumo, self.vehicle, self.driver, step_s, self.rng) if self.plan.aside_m else None
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng) if self.inattentive else None
        waiting = round(PATIENCE_S / step_s)
        while waiting and not self.hazard.shows(sumo, self.vehicle):
            yield from _roll(foot, step_s, step_s)
            waiting -= 1
        if waiting:
            before_s = max(self.driver.reaction_s, MODE_S) + (self.driver.look_away_s if self.inattentive else 0.0)
            yield from _roll(foot, before_s, step_s)
            if self._needed(sumo):
                if self.ttc_s is None or self.ttc_s > self.plan.steer_ttc_s:
                    hands = None
                # SUMO's driver would brake for everybody in the next lane once the vehicle is across the marking.
                foot = foot or Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
                yield from self._evade(sumo, foot, hands, step_s)
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)
        if foot is not None:
            yield from foot.lift()
            yield from release(sumo, self.vehicle, step_s)

    def _needed(self, sumo: Any) -> bool:
        """Note the cause, if there still is one."""
        gap = self.hazard.gap_m(sumo, self.vehicle)
        speed, (hazard_speed, hazard_mps2) = float(sumo.vehicle.getSpeed(self.vehicle)), self.hazard.motion(sumo)
        ttc = time_to_collision_s(gap, speed - hazard_speed)
        needed = braking_mps2(gap, speed, hazard_speed, hazard_mps2, STANDSTILL_M) if 0.0 < gap < np.inf else 0.0
        if gap <= 0.0 or (ttc > CALM_TTC_S and needed < CALM_MPS2):
            return False
        self.cause = self.hazard.cause(sumo)
        self.ttc_s = ttc if np.isfinite(ttc) else None
        return True

    def _evade(self, sumo: Any, foot: Foot, hands: Hands | None, step_s: float) -> Steps:
        time_s = max((self.ttc_s or CALM_TTC_S) - 0.3, 0.6)
        # Out and to rest within the time takes 4 x / t^2; a driver in an emergency takes more.
        limit = float(np.clip(self.driver.effort_gain * 4.0 * abs(self.plan.aside_m) / time_s**2, *STEERING_MPS2))
        pass_mps = self.plan.pass_share * float(sumo.vehicle.getSpeed(self.vehicle))
        past = False
        for _ in range(round(LONGEST_S / step_s)):
            if not past and self._past(sumo):
                past = True
                foot.limb.decide_now()
            across = 0.0 if hands is None else hands.limb.acceleration
            foot.push(lambda: -min(self._braking(sumo, pass_mps), pedal_limit(across)))  # noqa: B023 - called now
            if hands is not None:
                back = past and not self.plan.stays
                hands.steer(0.0 if back else self.plan.aside_m, BACK_SHARE * limit if back else limit)
            yield
            if past and (hands is None or hands.still) and foot.limb.acceleration > -0.3:
                return

    def _past(self, sumo: Any) -> bool:
        """Whether the hazard is behind, gone, or no longer closing."""
        gap = self.hazard.gap_m(sumo, self.vehicle)
        if isinstance(self.hazard, Debris):
            return gap < -float(sumo.vehicle.getLength(self.vehicle))
        speed = float(sumo.vehicle.getSpeed(self.vehicle))
        hazard_speed, hazard_mps2 = self.hazard.motion(sumo)
        calm = time_to_collision_s(gap, speed - hazard_speed) > CALM_TTC_S and hazard_mps2 > -0.5
        return bool(not 0.0 < gap < np.inf or calm)

    def _braking(self, sumo: Any, pass_mps: float) -> float:
        """The deceleration that the driver means now, m/s2."""
        speed = float(sumo.vehicle.getSpeed(self.vehicle))
        others = _braking_for_leader(sumo, self.vehicle, speed)
        gap = self.hazard.gap_m(sumo, self.vehicle)
        if not self.plan.brakes or not 0.0 < gap < np.inf:
            return others
        if isinstance(self.hazard, Debris):
            needed = max(0.0, speed**2 - pass_mps**2) / (2.0 * max(gap, 2.0))
        else:
            needed = braking_mps2(gap, speed, *self.hazard.motion(sumo), STANDSTILL_M)
        return max(self.driver.effort_gain * needed, others)


def _braking_for_leader(sumo: Any, vehicle: str, speed: float) -> float:
    """The deceleration that keeps a vehicle off whoever is ahead in its lane, m/s2."""
    leader = sumo.vehicle.getLeader(vehicle, LEADER_M)
    if not leader or leader[1] > LEADER_S * speed:
        return 0.0
    name, gap = leader
    leader_speed, leader_mps2 = float(sumo.vehicle.getSpeed(name)), float(sumo.vehicle.getAcceleration(name))
    return braking_mps2(float(gap), speed, leader_speed, leader_mps2, STANDSTILL_M)


def _roll(foot: Foot | None, duration_s: float, step_s: float) -> Steps:
    """Wait; with a foot on the pedals, at no acceleration."""
    for _ in range(round(duration_s / step_s)):
        if foot is not None:
            foot.push(lambda: 0.0)
        yield


@dataclass
class Surge(Reaction):
    """Accelerate to `goal_mps`, as hard as the driver means and the engine gives, behind whoever is ahead.

    peak_mps2: largest acceleration that is meant. power_w_per_kg: of the vehicle; limits acceleration times speed.
    headway_s: time gap to the vehicle ahead at which the driver stops accelerating. reason: the cause to note, empty
    where there is none.
    """

    vehicle: str
    goal_mps: float
    peak_mps2: float
    power_w_per_kg: float
    headway_s: float
    driver: Driver
    rng: np.random.Generator
    reason: str = ""
    name: str = "hard_accel"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        if self.reason:
            yield from wait(self.driver.reaction_s, step_s)
        self.cause = self.reason
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        for step in range(round(LONGEST_S / step_s)):
            foot.push(lambda: self._meant(sumo, foot.speed))
            yield
            eased = foot.limb.acceleration < 0.5 and step * step_s > 1.0
            if foot.speed > self.goal_mps - 0.3 or eased:
                break
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)

    def _meant(self, sumo: Any, speed: float) -> float:
        limit = min(self.peak_mps2, self.power_w_per_kg / max(speed, 1.0))
        meant = min(max(EAGERNESS_PER_S * (self.goal_mps - speed), -limit), limit)
        leader = sumo.vehicle.getLeader(self.vehicle, LEADER_M)
        if leader:
            room = leader[1] - STANDSTILL_M - speed * self.headway_s
            closing = max(0.0, speed - float(sumo.vehicle.getSpeed(leader[0])))
            needed = closing**2 / (2.0 * max(room, 0.5))
            meant = min(meant, limit * (1.0 - needed / CLOSING_MPS2)) if needed < CLOSING_MPS2 else -needed
        return max(meant, -2.0 * CLOSING_MPS2)


@dataclass
class BrakeCommand:
    """Brake without a cause: harder and harder for `rise_s`, up to `peak_mps2`, and then on.

    The speed falls by `drop_mps` beside what `rise_s` takes, but not below `floor_mps`.
    """

    vehicle: str
    peak_mps2: float
    rise_s: float
    drop_mps: float
    floor_mps: float
    driver: Driver
    rng: np.random.Generator
    name: str = "hard_brake"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        goal = max(self.floor_mps, foot.speed - self.peak_mps2 * self.rise_s / 2.0 - self.drop_mps)
        for step in range(round(LONGEST_S / step_s)):
            risen = min(1.0, step * step_s / self.rise_s) if self.rise_s else 1.0
            limit = risen * self.peak_mps2
            foot.push(lambda: min(max(EAGERNESS_PER_S * (goal - foot.speed), -limit), 0.0))  # noqa: B023 - called now
            yield
            if foot.speed < goal + 0.5:
                break
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)


@dataclass
class SwerveCommand:
    """Swerve without a cause: `offset_m` aside (positive to the faster side) at up to `peak_mps2`, and back.

    hold_s: time between reaching the offset and turning back, s.
    """

    vehicle: str
    offset_m: float
    peak_mps2: float
    hold_s: float
    driver: Driver
    rng: np.random.Generator
    name: str = "evasive_swerve"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        hands = Hands(sumo, self.vehicle, self.driver, step_s, self.rng)
        yield from wait(MODE_S, step_s)
        foot = Foot(sumo, self.vehicle, self.driver, step_s, self.rng)
        reached_s = 0.0
        for _ in range(round(LONGEST_S / step_s)):
            if abs(hands.moved_m) > 0.85 * abs(self.offset_m) or reached_s:
                reached_s += step_s
            out = reached_s <= self.hold_s
            limit = pedal_limit(hands.limb.acceleration)
            foot.push(lambda: -min(_braking_for_leader(sumo, self.vehicle, foot.speed), limit))  # noqa: B023 - called now
            hands.steer(self.offset_m if out else 0.0, self.peak_mps2 if out else BACK_SHARE * self.peak_mps2)
            yield
            if not out and hands.still:
                break
        sumo.vehicle.setLaneChangeMode(self.vehicle, DEFAULT_LANE_CHANGE_MODE)
        yield from foot.lift()
        yield from release(sumo, self.vehicle, step_s)


@dataclass
class BriskStart(Reaction):
    """Start hard when the light turns green: SUMO's driver may accelerate by `peak_mps2` for a while.

    The driver keeps its distance and obeys the light. settings: the times. lasts_s: how long, s.
    """

    vehicle: str
    peak_mps2: float
    lasts_s: float
    settings: BriskStartSettings
    name: str = "hard_accel"

    def steps(self, sumo: Any, step_s: float) -> Steps:
        get = sumo.vehicle
        for _ in range(round(self.settings.wait_s / step_s)):
            if get.getSpeed(self.vehicle) > STARTS_MPS:
                break
            yield
        else:
            return
        self.cause = "green_light"
        usual = float(get.getAccel(self.vehicle))
        peak = max(self.peak_mps2, usual)
        yield from self._fade(sumo, usual, peak, step_s)
        yield from wait(self.lasts_s, step_s)
        yield from self._fade(sumo, peak, usual, step_s)

    def _fade(self, sumo: Any, start: float, end: float, step_s: float) -> Steps:
        for acceleration in np.linspace(start, end, 1 + round(self.settings.rise_s / step_s))[1:]:
            sumo.vehicle.setAccel(self.vehicle, float(acceleration))
            yield
