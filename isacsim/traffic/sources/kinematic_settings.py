"""What the kinematic motion source draws from: ranges with units, bounds and sources.

Every range is drawn from evenly, anew for each scene. docs/settings.md lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from isac_cosim.base.setting_fields import Range, range_within, sourced
from isac_cosim.base.settings import Settings

Seconds = Annotated[Range, range_within(0.0, 30.0)]
Metres = Annotated[Range, range_within(0.0, 200.0)]
Speeds = Annotated[Range, range_within(1.0, 60.0)]
Differences = Annotated[Range, range_within(-30.0, 30.0)]
Accelerations = Annotated[Range, range_within(0.0, 9.0)]
Jerks = Annotated[Range, range_within(0.5, 25.0)]


class SituationSettings(Settings):
    """The TV behind the UV in one lane, before anything happens; the same for every intention unless stated there."""

    uv_speed_mps: Speeds = sourced((16.0, 32.0), "speed of the UV, m/s", "chosen: rural roads to motorways")
    gap_m: Metres = sourced(
        (22.0, 80.0), "gap from the TV to the UV at onset, m", "chosen: headways of 0.7 to 5 s; free-flow driving"
    )
    closing_mps: Differences = sourced(
        (-3.0, 4.0), "speed of the TV minus that of the UV, m/s", "chosen: drivers about to act are rarely settled"
    )
    lane_sway_m: Annotated[Range, range_within(0.0, 1.0)] = sourced(
        (0.05, 0.2), "amplitude of the position in the lane, m", "chosen: about 0.1 m rms; 0.2 m is usual on the road"
    )
    lane_sway_s: Annotated[Range, range_within(1.0, 60.0)] = sourced(
        (7.0, 14.0), "period of that, s", "chosen: keeps the lateral speed below 0.2 m/s"
    )
    speed_sway_mps2: Annotated[Range, range_within(0.0, 2.0)] = sourced(
        (0.05, 0.35), "amplitude of the acceleration in steady driving, m/s2", "chosen: below what a passenger notices"
    )
    speed_sway_s: Annotated[Range, range_within(1.0, 60.0)] = sourced(
        (6.0, 15.0), "period of that, s", "chosen: the speed wanders by less than 1 m/s"
    )
    length_m: Annotated[Range, range_within(2.0, 20.0)] = sourced(
        (4.0, 5.0), "length of both cars, m", "chosen: passenger cars"
    )
    position_spread_m: float = sourced(
        20.0, "largest distance of the TV at onset from the middle of the sites, m", "chosen: all sites see it",
        ge=0.0, le=500.0,
    )  # fmt: skip


class ResponseSettings(Settings):
    """What is uncertain about a driver: the first response, and whether there is a cause.

    The first response is mild braking or accelerating, with which a driver begins several maneuvers: one may brake
    first and then brake hard, swerve or change lanes; or accelerate first and then accelerate hard, change lanes or
    overtake. As long as it lasts, not even the true motion says which. `share` is calibrated
    (`python -m isac_cosim.benchmarks.findings.kinematic_calibration`); nothing else is.
    """

    share: float = sourced(
        0.3, "share of maneuvers that begin with a first response", "calibrated on truth; see above",
        ge=0.0, le=1.0,
    )  # fmt: skip
    duration_s: Seconds = sourced(
        (0.4, 1.6), "time from the first response to the maneuver proper, s", "chosen: about one reaction time"
    )
    overlap_s: Seconds = sourced(
        (0.0, 1.0), "time that the first response goes on into a lateral maneuver, s", "chosen: pedal and wheel overlap"
    )
    braking_mps2: Accelerations = sourced(
        (1.0, 3.5), "deceleration of the first response, m/s2", "up to the comfortable 3.5 m/s2 of ISO 15622"
    )
    accelerating_mps2: Accelerations = sourced(
        (0.7, 2.0), "acceleration of the first response, m/s2", "up to the comfortable 2 m/s2 of ISO 15622"
    )
    jerk_mps3: Jerks = sourced((3.0, 8.0), "jerk of the first response, m/s3", "chosen: gentler than in an emergency")
    cause_share: float = sourced(
        0.5, "share of reactions to the UV, where an intention can be one", "chosen: as many with a cause as without",
        ge=0.0, le=1.0,
    )  # fmt: skip
    reaction_s: Annotated[Range, range_within(0.1, 5.0)] = sourced(
        (0.6, 1.5), "time from the UV's motion to the TV's, s", "brake reaction times, Green 2000: 0.7 to 1.5 s"
    )
    uv_braking_mps2: Accelerations = sourced(
        (2.0, 6.0), "deceleration of the UV as a cause, m/s2", "chosen: from brisk braking to an emergency"
    )
    uv_accelerating_mps2: Accelerations = sourced(
        (1.0, 2.5), "acceleration of the UV as a cause, m/s2", "chosen: a queue that dissolves"
    )
    uv_hold_s: Seconds = sourced((0.4, 1.6), "time at that acceleration, s", "chosen: the UV keeps moving")


class KinematicBrakeSettings(Settings):
    """A hard brake."""

    peak_mps2: Accelerations = sourced((4.3, 8.0), "largest deceleration, m/s2", "UN R157: emergency from 5 m/s2")
    hold_s: Seconds = sourced((0.5, 1.8), "time at the peak, s", "chosen: the TV keeps moving")
    jerk_mps3: Jerks = sourced((8.0, 18.0), "jerk, m/s3", "chosen: the peak is reached within 0.4 to 1.6 s")


class KinematicAccelSettings(Settings):
    """A hard acceleration."""

    peak_mps2: Accelerations = sourced((2.7, 4.5), "largest acceleration, m/s2", "driving-style studies: to 3.6 m/s2")
    hold_s: Seconds = sourced((1.0, 2.2), "time at the peak, s", "chosen: the speed grows by 4 to 14 m/s")
    jerk_mps3: Jerks = sourced((4.0, 10.0), "jerk, m/s3", "chosen: the peak is reached within 0.4 to 1.8 s")


class KinematicChangeSettings(Settings):
    """A lane change to either side, also the pulling-out and the return of an overtake."""

    duration_s: Annotated[Range, range_within(1.0, 15.0)] = sourced(
        (3.5, 6.5), "time from lane to lane, s", "Toledo & Zohar 2007: mean 4.6 s, sd 2.3 s"
    )
    acceleration_mps2: Annotated[Range, range_within(-3.0, 3.0)] = sourced(
        (-1.0, 1.0), "acceleration along the road meanwhile, m/s2", "chosen: adapting to the new lane"
    )
    pulse_s: Seconds = sourced((1.0, 2.5), "time of that, s", "chosen: during the lane change")


class KinematicOvertakeSettings(Settings):
    """An overtake: pulling out, passing the UV and returning ahead of it."""

    closing_mps: Differences = sourced(
        (2.0, 9.0), "speed of the TV minus that of the UV at onset, m/s", "chosen: a slower vehicle is the reason"
    )
    acceleration_mps2: Annotated[Range, range_within(-3.0, 3.0)] = sourced(
        (0.0, 1.6), "acceleration while pulling out, m/s2", "chosen: drivers accelerate to pass"
    )
    passing_mps: Differences = sourced(
        (6.0, 10.0), "least speed of the TV minus that of the UV while passing, m/s", "chosen: done within 30 s"
    )
    clear_m: Metres = sourced(
        (8.0, 22.0), "distance of the TV's rear ahead of the UV's front at the return, m", "chosen: seen in the mirror"
    )


class SwerveSettings(Settings):
    """An evasive swerve to either side and back."""

    aside_m: Metres = sourced((1.0, 2.0), "distance moved aside, m", "chosen: the width of an obstacle in the lane")
    peak_mps2: Annotated[Range, range_within(0.5, 9.0)] = sourced(
        (3.8, 5.5), "largest lateral acceleration, m/s2", "drivers swerve at 0.3 to 0.7 g"
    )
    hold_s: Seconds = sourced((0.1, 0.8), "time aside, s", "chosen: past the obstacle")
    return_ratio: Annotated[Range, range_within(0.5, 5.0)] = sourced(
        (1.0, 1.6), "duration of the return over that of the move aside", "chosen: drivers return less hastily"
    )


class KinematicFollowingSettings(Settings):
    """Following, the benign state: the UV may change its speed gently, and the TV follows."""

    closing_mps: Differences = sourced(
        (-0.8, 0.8), "speed of the TV minus that of the UV, m/s", "chosen: settled for ten seconds either way"
    )
    acceleration_mps2: Annotated[Range, range_within(-2.0, 2.0)] = sourced(
        (-1.5, 1.5), "gentle acceleration of the UV, which the TV repeats, m/s2", "chosen: below 2 m/s2, comfortable"
    )
    headway_s: Annotated[Range, range_within(0.3, 10.0)] = sourced(
        (0.9, 2.4), "gap over the speed of the TV, s", "chosen: time headways in dense traffic"
    )


class LimitSettings(Settings):
    """Which drawn scenes are kept; others are drawn again."""

    least_gap_m: float = sourced(
        2.0, "least gap between the vehicles in one lane, m", "chosen: nobody touches", ge=0.0, le=50.0
    )
    least_speed_mps: float = sourced(2.0, "least speed, m/s", "chosen: nobody stops or reverses", ge=0.0, le=20.0)
    acceleration_mps2: float = sourced(
        9.0, "largest acceleration in the plane, m/s2", "what a passenger car can do", ge=1.0, le=20.0
    )
    jerk_mps3: float = sourced(25.0, "largest jerk in the plane, m/s3", "what a passenger car can do", ge=1.0, le=100.0)
    draws: int = sourced(400, "draws of one scene before giving up", "chosen: one to ten are usual", ge=1, le=10_000)


OVERLAP: Mapping[str, Mapping[str, Any]] = {
    "response": {"share": 0.75, "braking_mps2": (2.0, 6.0)},
    "hard_brake": {"peak_mps2": (3.0, 6.0)},
    "overtake": {"closing_mps": (6.0, 12.0), "acceleration_mps2": (1.5, 3.0)},
}
"""What differs from the defaults in the world `overlap-1`: the opposite assumptions about two pairs of intentions. A
driver may brake as hard before a swerve or a lane change as in a hard brake, so that the brake alone tells less; and
overtakes are so fast that a window shows what they are. `response.share` is calibrated as the default is."""


class KinematicSettings(Settings):
    """The kinematic motion source: scenes of one TV and one UV on a straight road, equally many of each intention."""

    per_class: int = sourced(
        16, "scenes of each known intention in an episode", "chosen: as `selection.per_class`", ge=0, le=1000
    )
    following_scenes: int = sourced(
        8, "scenes of `following` in an episode", "chosen: as `selection.following`", ge=0, le=1000
    )
    lead_s: float = sourced(
        5.0, "motion before onset, but for `following`, s", "chosen: a default record needs 3.6 s",
        ge=2.0, le=20.0,
    )  # fmt: skip
    settle_s: float = sourced(
        3.2, "time after onset from which the TV adapts its speed to the UV's or completes its overtake, s",
        "chosen: after the end of a record of default length", ge=2.0, le=20.0,
    )  # fmt: skip
    situation: SituationSettings = SituationSettings()
    response: ResponseSettings = ResponseSettings()
    hard_brake: KinematicBrakeSettings = KinematicBrakeSettings()
    hard_accel: KinematicAccelSettings = KinematicAccelSettings()
    lane_change: KinematicChangeSettings = KinematicChangeSettings()
    overtake: KinematicOvertakeSettings = KinematicOvertakeSettings()
    evasive_swerve: SwerveSettings = SwerveSettings()
    following: KinematicFollowingSettings = KinematicFollowingSettings()
    limits: LimitSettings = LimitSettings()
