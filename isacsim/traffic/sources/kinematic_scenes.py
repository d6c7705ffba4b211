"""Scenes of the kinematic motion source: one TV and one UV on a straight road, from drawn parameters to motion.

A scene is a sum of pulses of acceleration along the road and of moves across it. Time 0 is the onset. The TV is behind
the UV in one lane when the scene begins, whatever it intends, so that the place of the UV tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.setting_fields import Range
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings

STEP_S = 0.01
STEADY_LEAD_S, STEADY_AFTER_S = 10.2, 12.8
"""Motion of a `following` scene before and after its instant, s: its definition wants 10 s without another event."""
LANE_CHANGE_AFTER_S = 33.0
"""Motion after the onset of a lane change or an overtake, s: what it was for shows within 30 s."""
AFTER_S = 9.0
"""Motion after the onset of other maneuvers, s."""
BESIDE_M = 2.0
"""Lateral distance below which two cars are in each other's way, m."""
SETTLING_MPS2 = (1.5, 3.0)
"""Acceleration with which the TV adapts its speed after the record, m/s2."""


@dataclass(frozen=True)
class Motion:
    """Motion of one vehicle, arrays of shape (n,).

    along: position of the front bumper along the road, m. left: position across it, m to the left of the centre line
    of the lane in which the vehicle starts. speed: along the road, m/s.
    """

    along: Array
    left: Array
    speed: Array
    length_m: float


@dataclass(frozen=True)
class Scene:
    """One maneuver of a TV behind a UV.

    times: s, 0 at the onset, shape (n,). commit, end: of the maneuver, s after its onset. cause: what the TV reacts to,
    empty if nothing.
    """

    intention: str
    times: Array
    tv: Motion
    uv: Motion
    commit: float
    end: float
    cause: str


@dataclass
class SceneMotion:
    """What happens in a scene; its methods of drawing fill it in.

    tv_mps2, uv_mps2: acceleration along the road, m/s2, (n,). left: of the TV across the road, m, (n,). busy_until: end
    of the TV's motion along the road, s. commit: None where the TV crosses the marking.
    """

    tv_mps2: Array
    uv_mps2: Array
    left: Array
    closing_mps: float
    gap_m: float
    commit: float | None = None
    end: float = 0.0
    busy_until: float = 0.0
    cause: str = ""


class SceneDraw:
    """Draws one scene. rng: of this scene and attempt. width_m: of a lane."""

    def __init__(self, intention: str, settings: KinematicSettings, width_m: float, rng: np.random.Generator) -> None:
        self.intention, self.settings, self.width_m, self._rng = intention, settings, width_m, rng
        lead, after = span_s(intention, settings)
        self.times = np.asarray(np.arange(-round(lead / STEP_S), round(after / STEP_S) + 1) * STEP_S)

    def scene(self) -> Scene | None:
        """Return the scene, or None where it breaks a limit and has to be drawn again."""
        uv_mps = self._draw(self.settings.situation.uv_speed_mps)
        lengths = self._draw(self.settings.situation.length_m), self._draw(self.settings.situation.length_m)
        plan = self._empty_plan()
        PLANS[self.intention](self, plan, uv_mps)
        uv_speed = integral(plan.uv_mps2 + self._speed_sway(), STEP_S, uv_mps)
        sway_mps2 = self._speed_sway()
        tv_speed = integral(plan.tv_mps2 + sway_mps2, STEP_S, uv_mps + plan.closing_mps)
        settling = self._settling(plan, float(tv_speed[-1] - uv_speed[-1]))
        tv_speed = tv_speed + integral(settling, STEP_S)
        zero = int(np.searchsorted(self.times, -STEP_S / 2))
        tv_along, uv_along = integral(tv_speed, STEP_S), integral(uv_speed, STEP_S)
        tv_along -= tv_along[zero]
        uv_along += plan.gap_m + lengths[1] - uv_along[zero]
        if self.intention == "overtake" and not self._return(plan, tv_along - lengths[0] - uv_along):
            return None
        tv = Motion(tv_along, plan.left + self._lane_sway(), tv_speed, lengths[0])
        uv = Motion(uv_along, self._lane_sway(), uv_speed, lengths[1])
        if not self._within_limits(tv, uv, plan.tv_mps2 + sway_mps2 + settling):
            return None
        commit = self._crossing_time(tv) if plan.commit is None else plan.commit
        return Scene(self.intention, self.times, tv, uv, commit, max(plan.end, commit), plan.cause)

    def _draw(self, ends: Range) -> float:
        return float(self._rng.uniform(*ends))

    def _empty_plan(self) -> SceneMotion:
        situation = self.settings.situation
        still = np.zeros_like(self.times)
        return SceneMotion(still, still, still, self._draw(situation.closing_mps), self._draw(situation.gap_m))

    def _speed_sway(self) -> Array:
        s = self.settings.situation
        return sway(self.times, self._draw(s.speed_sway_mps2), self._draw(s.speed_sway_s), self._draw((0.0, 2 * np.pi)))

    def _lane_sway(self) -> Array:
        s = self.settings.situation
        return sway(self.times, self._draw(s.lane_sway_m), self._draw(s.lane_sway_s), self._draw((0.0, 2 * np.pi)))

    def _first_response(self) -> float | None:
        """Draw whether there is a first response; return how long it lasts before the maneuver proper, s."""
        response = self.settings.response
        lasts_s = self._draw(response.duration_s)
        return lasts_s if self._rng.random() < response.share else None

    def _uv_acts(self, plan: SceneMotion, braking: bool) -> None:
        """Draw whether the TV reacts to the UV, and the motion of the UV if so."""
        response = self.settings.response
        if self._rng.random() >= response.cause_share:
            return
        peak = -self._draw(response.uv_braking_mps2) if braking else self._draw(response.uv_accelerating_mps2)
        jerks = self.settings.hard_brake.jerk_mps3 if braking else self.settings.hard_accel.jerk_mps3
        ramp_s, hold_s = ramp_of(peak, self._draw(jerks)), self._draw(response.uv_hold_s)
        plan.uv_mps2 = plan.uv_mps2 + pulse(self.times, -self._draw(response.reaction_s), peak, ramp_s, hold_s)
        plan.cause = "uv_brakes" if braking else "uv_accelerates"

    def _respond_first(self, plan: SceneMotion, lasts_s: float, braking: bool, overlap_s: float) -> None:
        """Add the first response: it is fully released `overlap_s` and its ramp after the maneuver proper begins."""
        response = self.settings.response
        peak = -self._draw(response.braking_mps2) if braking else self._draw(response.accelerating_mps2)
        ramp_s = ramp_of(peak, self._draw(response.jerk_mps3))
        hold_s = max(0.0, lasts_s + overlap_s - ramp_s)
        plan.tv_mps2 = plan.tv_mps2 + pulse(self.times, 0.0, peak, ramp_s, hold_s)
        plan.busy_until = 2 * ramp_s + hold_s

    def change_speed(self, plan: SceneMotion, braking: bool, peak_mps2: Range, jerk_mps3: Range, hold_s: Range) -> None:
        """Plan a hard brake or a hard acceleration, perhaps mild at first."""
        lasts_s = self._first_response()
        start = lasts_s or 0.0
        peak = -self._draw(peak_mps2) if braking else self._draw(peak_mps2)
        ramp_s, plateau_s = ramp_of(peak, self._draw(jerk_mps3)), self._draw(hold_s)
        self._uv_acts(plan, braking)
        if lasts_s is not None:
            self._respond_first(plan, lasts_s, braking, overlap_s=ramp_s)
        hard = pulse(self.times, start, peak, ramp_s, plateau_s)
        plan.tv_mps2 = np.minimum(plan.tv_mps2, hard) if braking else np.maximum(plan.tv_mps2, hard)
        plan.commit, plan.end = start + ramp_s, start + 2 * ramp_s + plateau_s
        plan.busy_until = max(plan.busy_until, plan.end)

    def begin_sideways(self, plan: SceneMotion, braking: bool) -> float:
        """Plan what comes before a lateral maneuver; return when that begins, s."""
        lasts_s = self._first_response()
        if braking:
            self._uv_acts(plan, braking)
        if lasts_s is None:
            return 0.0
        self._respond_first(plan, lasts_s, braking, self._draw(self.settings.response.overlap_s))
        return lasts_s

    def change_lane(self, plan: SceneMotion, side: float, braking: bool, acceleration_mps2: Range) -> None:
        """Plan a move to the next lane. side: 1 for the left, -1 for the right. braking: the first response."""
        s = self.settings.lane_change
        start, duration_s = self.begin_sideways(plan, braking), self._draw(s.duration_s)
        plan.left = plan.left + move_aside(self.times, start, side * self.width_m, duration_s)
        pulse_s = self._draw(s.pulse_s) / 2
        plan.tv_mps2 = plan.tv_mps2 + pulse(self.times, start, self._draw(acceleration_mps2), pulse_s, 0.0)
        plan.end = start + duration_s
        plan.busy_until = max(plan.busy_until, start + 2 * pulse_s)

    def either(self) -> bool:
        """Draw one of two equally likely cases."""
        return bool(self._rng.random() < 0.5)

    def swerve(self, plan: SceneMotion) -> None:
        """Plan a move aside and back."""
        s = self.settings.evasive_swerve
        start = self.begin_sideways(plan, braking=True)
        aside_m = self._draw(s.aside_m) * (1.0 if self.either() else -1.0)
        out_s = duration_of(aside_m, self._draw(s.peak_mps2))
        back = start + out_s + self._draw(s.hold_s)
        back_s = out_s * self._draw(s.return_ratio)
        plan.left = plan.left + move_aside(self.times, start, aside_m, out_s)
        plan.left = plan.left + move_aside(self.times, back, -aside_m, back_s)
        plan.commit, plan.end = start + out_s, back + back_s

    def follow(self, plan: SceneMotion, uv_mps: float) -> None:
        """Plan steady driving: the UV may change its speed gently, and the TV repeats that after its reaction time."""
        s, response = self.settings.following, self.settings.response
        plan.closing_mps = self._draw(s.closing_mps)
        plan.gap_m = self._draw(s.headway_s) * (uv_mps + plan.closing_mps)
        peak, at = self._draw(s.acceleration_mps2), self._draw((-3.0, 2.0))
        ramp_s = ramp_of(2.0, self._draw(response.jerk_mps3))
        hold_s, delay_s = self._draw(response.uv_hold_s), self._draw(response.reaction_s)
        if self.either():
            plan.uv_mps2 = plan.uv_mps2 + pulse(self.times, at, peak, ramp_s, hold_s)
            plan.tv_mps2 = plan.tv_mps2 + pulse(self.times, at + delay_s, peak, ramp_s, hold_s)
        plan.commit = plan.end = 0.0

    def overtake(self, plan: SceneMotion) -> None:
        """Plan the pulling-out of an overtake; the return follows when the passing is known."""
        plan.closing_mps = self._draw(self.settings.overtake.closing_mps)
        self.change_lane(plan, 1.0, braking=False, acceleration_mps2=self.settings.overtake.acceleration_mps2)

    def _settling(self, plan: SceneMotion, closing_mps: float) -> Array:
        """Return the TV's acceleration after the record, m/s2, (n,): it passes the UV, or adapts to its speed.

        closing_mps: speed of the TV minus that of the UV when everything planned is over.
        """
        if self.intention == "overtake":
            change_mps = max(0.0, self._draw(self.settings.overtake.passing_mps) - closing_mps)
        elif self.intention == "following":
            change_mps = 0.0
        else:
            change_mps = -max(0.0, closing_mps + self._draw((0.0, 1.0)))
        peak = self._draw(SETTLING_MPS2) * np.sign(change_mps)
        if not peak:
            return np.zeros_like(self.times)
        ramp_s = max(1.0, change_mps / peak)
        return pulse(self.times, max(self.settings.settle_s, plan.busy_until), change_mps / ramp_s, ramp_s, 0.0)

    def _return(self, plan: SceneMotion, ahead_m: Array) -> bool:
        """Plan the return of an overtake; False where there is no time for it.

        ahead_m: distance of the TV's rear ahead of the UV's front, m, (n,).
        """
        s = self.settings
        clear = np.flatnonzero(ahead_m >= self._draw(s.overtake.clear_m))
        duration_s = self._draw(s.lane_change.duration_s)
        if not len(clear) or self.times[clear[0]] < plan.end:
            return False
        start = float(self.times[clear[0]])
        plan.left = plan.left + move_aside(self.times, start, -self.width_m, duration_s)
        plan.end = start + duration_s / 2
        return start + duration_s + 2.0 <= float(self.times[-1])

    def _crossing_time(self, tv: Motion) -> float:
        return float(self.times[int(np.argmax(np.abs(tv.left) > self.width_m / 2))])

    def _within_limits(self, tv: Motion, uv: Motion, tv_mps2: Array) -> bool:
        """Return whether nobody touches, stops, or moves as no car can, and only an overtaking TV passes the UV.

        tv_mps2: acceleration of the TV along the road, m/s2, (n,).
        """
        limits = self.settings.limits
        behind_m, ahead_m = uv.along - uv.length_m - tv.along, tv.along - tv.length_m - uv.along
        in_the_way = np.abs(tv.left - uv.left) < BESIDE_M
        apart_m = np.maximum(behind_m, ahead_m)[in_the_way]
        if float(apart_m.min(initial=np.inf)) < limits.least_gap_m:
            return False
        if self.intention != "overtake" and float(behind_m.min()) < limits.least_gap_m:
            return False
        if float(min(tv.speed.min(), uv.speed.min())) < limits.least_speed_mps:
            return False
        across_mps2 = np.gradient(np.gradient(tv.left, STEP_S), STEP_S)
        jerk_mps3 = float(np.hypot(np.diff(tv_mps2), np.diff(across_mps2)).max()) / STEP_S
        largest_mps2 = float(np.hypot(tv_mps2, across_mps2).max())
        return largest_mps2 <= limits.acceleration_mps2 and jerk_mps3 <= limits.jerk_mps3


def _hard_brake(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    s = draw.settings.hard_brake
    draw.change_speed(plan, True, s.peak_mps2, s.jerk_mps3, s.hold_s)


def _hard_accel(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    s = draw.settings.hard_accel
    draw.change_speed(plan, False, s.peak_mps2, s.jerk_mps3, s.hold_s)


def _left_lane_change(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    draw.change_lane(plan, 1.0, draw.either(), draw.settings.lane_change.acceleration_mps2)


def _right_lane_change(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    draw.change_lane(plan, -1.0, draw.either(), draw.settings.lane_change.acceleration_mps2)


def _overtake(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    draw.overtake(plan)


def _evasive_swerve(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    draw.swerve(plan)


def _following(draw: SceneDraw, plan: SceneMotion, uv_mps: float) -> None:
    draw.follow(plan, uv_mps)


PLANS: dict[str, Callable[[SceneDraw, SceneMotion, float], None]] = {
    "hard_brake": _hard_brake,
    "left_lane_change": _left_lane_change,
    "right_lane_change": _right_lane_change,
    "overtake": _overtake,
    "hard_accel": _hard_accel,
    "evasive_swerve": _evasive_swerve,
    "following": _following,
}
"""What fills in the plan of a scene, by intention. The third argument is the speed of the UV, m/s."""


def span_s(intention: str, settings: KinematicSettings) -> tuple[float, float]:
    """Return how long a scene lasts before and after its onset, s."""
    if intention == "following":
        return max(settings.lead_s, STEADY_LEAD_S), STEADY_AFTER_S
    lateral = intention in ("left_lane_change", "right_lane_change", "overtake")
    return settings.lead_s, LANE_CHANGE_AFTER_S if lateral else max(AFTER_S, settings.settle_s + 6.0)


def pulse(times: Array, start: float, peak: float, ramp_s: float, hold_s: float) -> Array:
    """Return a pulse of acceleration: a rise and a fall shaped like a half cosine, with a plateau in between.

    times: s, shape (n,). start: when it begins, s. peak: height of the plateau, m/s2, of either sign. ramp_s: duration
    of the rise and of the fall, s. hold_s: duration of the plateau, s.
    Returns m/s2, shape (n,). The speed changes by peak * (ramp_s + hold_s); the jerk is at most pi * |peak| /
    (2 * ramp_s).
    """
    rise = np.clip((times - start) / ramp_s, 0.0, 1.0)
    fall = np.clip((times - start - ramp_s - hold_s) / ramp_s, 0.0, 1.0)
    return np.asarray(peak * (np.cos(np.pi * fall) - np.cos(np.pi * rise)) / 2)


def ramp_of(peak: float, jerk_mps3: float) -> float:
    """Return the duration of the rise of a pulse that reaches `peak`, m/s2, with a largest jerk, m/s3, in s."""
    return float(np.pi * abs(peak) / (2 * jerk_mps3))


def move_aside(times: Array, start: float, distance_m: float, duration_s: float) -> Array:
    """Return a move aside whose lateral acceleration is one period of a sine.

    times: s, shape (n,). start: when it begins, s. distance_m: left positive, m.
    Returns the lateral position, m, shape (n,). The largest lateral speed is 2 * distance_m / duration_s and the
    largest acceleration 2 * pi * distance_m / duration_s ** 2.
    """
    share = np.clip((times - start) / duration_s, 0.0, 1.0)
    return np.asarray(distance_m * (share - np.sin(2 * np.pi * share) / (2 * np.pi)))


def duration_of(distance_m: float, peak_mps2: float) -> float:
    """Return how long a move aside with a largest lateral acceleration takes, s."""
    return float(np.sqrt(2 * np.pi * abs(distance_m) / peak_mps2))


def sway(times: Array, amplitude: float, period_s: float, phase: float) -> Array:
    """Return a sine: how a driver wanders about a steady value. phase: rad. Shape (n,), in the amplitude's unit."""
    return np.asarray(amplitude * np.sin(2 * np.pi * times / period_s + phase))


def integral(rates: Array, step_s: float, first: float = 0.0) -> Array:
    """Return the integral of an evenly sampled signal by the trapezoidal rule, shape (n,), beginning with `first`."""
    return np.asarray(first + np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2 * step_s)]))
