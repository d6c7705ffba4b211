"""Evading debris and vehicles: steering around them where there is room, braking, or both.

A reaction begins with the cause: the driver notices it after the reaction time, and only then moves foot or hands. What
the motion becomes follows from the driver model and from what is ahead meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from isac_cosim.base.setting_fields import sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.handling.controls import MODE_S, Foot, Hands, pedal_limit
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import Driver, braking_mps2, draw_driver
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView
from isac_cosim.isacsim.traffic.drivers.handling.hazards import Debris, Hazard, VehicleAhead, time_to_collision_s
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import DEFAULT_LANE_CHANGE_MODE, Steps, release
from isac_cosim.isacsim.traffic.drivers.maneuvers import kinds
from isac_cosim.isacsim.traffic.drivers.maneuvers.kinds import DirectorSettings, ManeuverCommand

CALM_TTC_S, CALM_MPS2 = 6.0, 1.5
"""A driver with more time to collision than this, and no need to brake harder than this, does not react."""
PATIENCE_S = 4.0
"""A hazard that is expected shows within this time, s, or not at all."""
STEERING_MPS2 = (2.0, 7.0)
"""Bounds of the lateral acceleration that a driver means in an emergency, m/s2."""


class EvasionSettings(Settings):
    """How drivers evade: debris in their lane, a vehicle that brakes or stands ahead, one that cuts in."""

    least_speed_mps: kinds.Speed = sourced(8.0, "only faster vehicles evade, m/s", "chosen: slower ones simply stop")
    notice_ttc_s: kinds.Durations = sourced(
        (2.2, 4.0), "time to collision at which debris comes into view, s", "chosen: hidden by the vehicle ahead"
    )
    lies_s: kinds.Durations = sourced(
        (0.0, 8.0), "time for which debris lies in the lane, s", "chosen: the next vehicles see it too"
    )
    debris_lateral_m: kinds.Distances = sourced(
        (-0.7, 0.7), "place of debris across the lane, from its middle, m", "chosen: in the way"
    )
    debris_half_width_m: kinds.Distances = sourced(
        (0.15, 0.6), "half the width of debris, m", "chosen: a box, a tyre, a plank"
    )
    margin_m: kinds.Distances = sourced(
        (0.1, 0.5), "clearance beside what is passed, m", "chosen: as close as people dare"
    )
    pass_share: kinds.Shares = sourced(
        (0.55, 0.95), "speed at which debris is passed, as a share of the speed before",
        "chosen: slower, seldom stopping",
    )  # fmt: skip
    steer_share: kinds.Share = sourced(
        0.75, "share of drivers with room beside who steer around debris", "chosen: most"
    )
    steer_ttc_s: kinds.Duration = sourced(
        2.2, "time to collision with a vehicle below which a driver may also steer, s", "chosen: braking comes first"
    )
    brake_share: kinds.Share = sourced(
        0.4, "share of those who steer around debris that also brake", "chosen: under half"
    )
    stay_share: kinds.Share = sourced(
        0.2, "share of those who steer with a free lane beside that stay in it", "chosen: a few"
    )
    clear_beside_m: kinds.Distance = sourced(
        12.0, "only to a side without vehicles this far ahead and behind, m", "chosen: no side contacts"
    )
    clear_beside_s: kinds.Duration = sourced(
        3.0, "nor any that would be so close after this time, s", "chosen: the time of a swerve"
    )
    lane_margin_m: kinds.Distance = sourced(
        0.1, "without a free lane beside, the vehicle's middle stays this far within its lane, m",
        "chosen: about a wheel on the line",
    )  # fmt: skip
    inattentive_share: kinds.Share = sourced(
        0.6, "share of drivers behind a vehicle that brakes hard or cuts in who look away at that moment",
        "chosen: conflicts are what is simulated here",
    )  # fmt: skip
    follower_s: kinds.Duration = sourced(
        2.5, "only drivers this close behind, as time gap, s", "chosen: others have time"
    )


class Evasions(DirectorSettings):
    evasion: EvasionSettings = EvasionSettings()


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
class Evasion(ManeuverCommand):
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
    name = "evasion"

    def __post_init__(self) -> None:
        self.startles = 0 if self.plan.brakes else None

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
        needed = braking_mps2(gap, speed, hazard_speed, hazard_mps2, kinds.STANDSTILL_M) if 0.0 < gap < np.inf else 0.0
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
        for _ in range(round(kinds.LONGEST_S / step_s)):
            if not past and self._past(sumo):
                past = True
                foot.limb.decide_now()
            across = 0.0 if hands is None else hands.limb.acceleration
            foot.push(lambda: -min(self._braking(sumo, pass_mps), pedal_limit(across)))  # noqa: B023 - called now
            if hands is not None:
                back = past and not self.plan.stays
                hands.steer(0.0 if back else self.plan.aside_m, kinds.BACK_SHARE * limit if back else limit)
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
        others = kinds.braking_for_leader(sumo, self.vehicle, speed)
        gap = self.hazard.gap_m(sumo, self.vehicle)
        if not self.plan.brakes or not 0.0 < gap < np.inf:
            return others
        if isinstance(self.hazard, Debris):
            needed = max(0.0, speed**2 - pass_mps**2) / (2.0 * max(gap, 2.0))
        else:
            needed = braking_mps2(gap, speed, *self.hazard.motion(sumo), kinds.STANDSTILL_M)
        return max(self.driver.effort_gain * needed, others)


def _roll(foot: Foot | None, duration_s: float, step_s: float) -> Steps:
    """Wait; with a foot on the pedals, at no acceleration."""
    for _ in range(round(duration_s / step_s)):
        if foot is not None:
            foot.push(lambda: 0.0)
        yield


def draw_debris_evasion(
    view: DriverView, debris: Debris, settings: Evasions, rng: np.random.Generator
) -> Evasion | None:
    """Return how a driver answers to debris: steering where there is room, braking, or both."""
    evasion = settings.evasion
    if view.speed <= evasion.least_speed_mps or not view.is_steady:
        return None
    away_m = view.lateral_m - debris.lateral_m
    clear_m = view.width_m / 2.0 + debris.half_width_m + rng.uniform(*evasion.margin_m)
    near_side = kinds.FASTER if away_m >= 0.0 else kinds.SLOWER
    options = {near_side: clear_m - abs(away_m), -near_side: clear_m + abs(away_m)}
    aside, stays = _aside(view, options, settings, rng)
    brakes = not aside or rng.random() < evasion.brake_share
    plan = EvasionPlan(brakes, aside, stays, pass_share=rng.uniform(*evasion.pass_share))
    return Evasion(view.vehicle, debris, plan, draw_driver(settings.driver, rng), rng.spawn(1)[0], inattentive=False)


def draw_answer(view: DriverView, ahead: VehicleAhead, settings: Evasions, rng: np.random.Generator) -> Evasion | None:
    """Return how an inattentive driver answers to a vehicle ahead: braking, and steering where time is short."""
    evasion = settings.evasion
    if view.speed <= evasion.least_speed_mps or not view.is_steady:
        return None
    width_m = view.width_m + rng.uniform(*evasion.margin_m)
    plan = EvasionPlan(
        True, *_aside(view, {kinds.FASTER: width_m, kinds.SLOWER: width_m}, settings, rng), evasion.steer_ttc_s
    )
    return Evasion(view.vehicle, ahead, plan, draw_driver(settings.driver, rng), rng.spawn(1)[0], inattentive=True)


def _aside(
    view: DriverView, options: dict[int, float], settings: Evasions, rng: np.random.Generator
) -> tuple[float, bool]:
    """Return how far a driver moves aside, m, 0 if not at all, and whether it stays in the next lane.

    options: the distance that it takes to each side, m; the shorter is preferred.
    """
    evasion = settings.evasion
    if not view.is_car or rng.random() >= evasion.steer_share:
        return 0.0, False
    within_lane_m = view.lane_width_m / 2.0 - evasion.lane_margin_m
    stays = rng.random() < evasion.stay_share
    for side, distance_m in sorted(options.items(), key=lambda option: option[1]):
        if view.has_room_beside(side, evasion.clear_beside_m, evasion.clear_beside_s):
            beside = view.has_lane(side, settings.stay_s)
            if stays and beside:
                return side * view.lane_width_m, True
            return side * (distance_m if beside else min(distance_m, within_lane_m - side * view.lateral_m)), False
    return 0.0, False
