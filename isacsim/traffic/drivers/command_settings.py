"""What maneuvers are drawn from: a settings section for each, with the source of every default.

Values are drawn evenly from a range, anew for each maneuver. A single value is a limit, a share or a constant.
docs/traffic.md lists them beside the thresholds of the labels.
"""

from __future__ import annotations

from typing import Annotated

from isac_cosim.base.setting_fields import LARGEST_MPS3, Range, sourced, within
from isac_cosim.base.settings import Settings


class BrakeCommandSettings(Settings):
    """A hard brake without a cause: the driver model brakes until the speed has fallen enough."""

    least_speed_mps: float = sourced(
        14.0, "only faster vehicles brake, m/s", "chosen: below, most brakes would be cut at floor_mps", ge=0.0, le=60.0
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = sourced(
        (3.6, 8.0),
        "largest deceleration that is meant, m/s2; the smaller the likelier, never the largest",
        "measured: half of SUMO's own hard brakes stay below 5 m/s²",
    )
    rise_s: Annotated[Range, within(0.0, 10.0)] = sourced(
        (0.1, 8.0),
        "time over which the driver brakes harder and harder, s; drawn evenly in its logarithm",
        "measured: half of SUMO's own hard brakes take 0.3 to 3 s to 4 m/s²",
    )
    drop_mps: Annotated[Range, within(1.0, 40.0)] = sourced(
        (4.0, 14.0), "by how much the speed falls beside what that takes, m/s", "chosen: brakes of 1 to 3 s"
    )
    floor_mps: float = sourced(
        5.0, "the speed falls no lower, m/s", "chosen: the vehicle keeps moving", ge=0.0, le=60.0
    )


class AccelCommandSettings(Settings):
    """A hard acceleration of a car: into a gap, onto the main road, or without a cause."""

    least_speed_mps: float = sourced(
        5.0, "only faster vehicles accelerate, m/s", "chosen: starts are a section of their own", ge=0.0, le=60.0
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = sourced(
        (2.8, 4.8),
        "largest acceleration that is meant, m/s2",
        "chosen: around the 3.6 m/s² of studies of driving style",
    )
    power_w_per_kg: Annotated[Range, within(10.0, 500.0)] = sourced(
        (80.0, 140.0),
        "engine power per mass, W/kg, which limits acceleration times speed",
        "chosen: cars of 120 to 210 kW and 1500 kg",
    )
    gain_mps: Annotated[Range, within(1.0, 40.0)] = sourced(
        (5.0, 14.0), "by how much the speed grows at most, m/s", "chosen: accelerations of 1.5 to 4 s"
    )
    least_gain_mps: float = sourced(
        4.5,
        "no acceleration where there is no room for this gain, m/s",
        "chosen: 2.5 m/s² for 1 s, and the ramps",
        ge=0.0,
        le=40.0,
    )
    headway_s: Annotated[Range, within(0.1, 5.0)] = sourced(
        (0.4, 1.0), "time gap at which the driver stops closing in, s", "published: Vogel 2003, headways of below 1 s"
    )
    impatience_gain: Annotated[Range, within(0.5, 2.0)] = sourced(
        (1.0, 1.25), "speed that an impatient driver accepts, over its usual desired speed", "chosen: for a while"
    )


class BriskStartSettings(Settings):
    """A hard acceleration from a standstill when the light turns green or the queue moves."""

    wait_s: float = sourced(
        90.0, "given up when not moving after this time, s", "chosen: longer than a red light", gt=0.0, le=600.0
    )
    within_m: float = sourced(
        80.0, "only vehicles that stand this close to a traffic light, m", "chosen: the queue", gt=0.0, le=1000.0
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = sourced(
        (3.0, 4.8),
        "acceleration that the driver may use, m/s2",
        "chosen: around the 3.6 m/s² of studies of driving style",
    )
    rise_s: float = sourced(0.6, "time over which it comes and goes, s", "chosen: no jump", gt=0.0, le=10.0)
    lasts_s: Annotated[Range, within(0.5, 60.0)] = sourced(
        (3.0, 6.0), "time for which the driver may use it, s", "chosen: up to the usual speed in a street"
    )


class EvasionSettings(Settings):
    """How drivers evade: debris in their lane, a vehicle that brakes or stands ahead, one that cuts in."""

    least_speed_mps: float = sourced(
        8.0, "only faster vehicles evade, m/s", "chosen: slower ones simply stop", ge=0.0, le=60.0
    )
    notice_ttc_s: Annotated[Range, within(0.5, 20.0)] = sourced(
        (2.2, 4.0), "time to collision at which debris comes into view, s", "chosen: hidden by the vehicle ahead"
    )
    lies_s: Annotated[Range, within(0.0, 600.0)] = sourced(
        (0.0, 8.0), "time for which debris lies in the lane, s", "chosen: the next vehicles see it too"
    )
    debris_lateral_m: Annotated[Range, within(-2.0, 2.0)] = sourced(
        (-0.7, 0.7), "place of debris across the lane, from its middle, m", "chosen: in the way"
    )
    debris_half_width_m: Annotated[Range, within(0.05, 2.0)] = sourced(
        (0.15, 0.6), "half the width of debris, m", "chosen: a box, a tyre, a plank"
    )
    margin_m: Annotated[Range, within(0.0, 2.0)] = sourced(
        (0.1, 0.5), "clearance beside what is passed, m", "chosen: as close as people dare"
    )
    pass_share: Annotated[Range, within(0.1, 1.0)] = sourced(
        (0.55, 0.95),
        "speed at which debris is passed, as a share of the speed before",
        "chosen: slower, seldom stopping",
    )
    steer_share: float = sourced(
        0.75, "share of drivers with room beside who steer around debris", "chosen: most", ge=0.0, le=1.0
    )
    steer_ttc_s: float = sourced(
        2.2,
        "time to collision with a vehicle below which a driver may also steer, s",
        "chosen: braking comes first",
        ge=0.0,
        le=20.0,
    )
    brake_share: float = sourced(
        0.4, "share of those who steer around debris that also brake", "chosen: under half", ge=0.0, le=1.0
    )
    stay_share: float = sourced(
        0.2, "share of those who steer with a free lane beside that stay in it", "chosen: a few", ge=0.0, le=1.0
    )
    clear_beside_m: float = sourced(
        12.0, "only to a side without vehicles this far ahead and behind, m", "chosen: no side contacts", ge=0.0, le=500
    )
    clear_beside_s: float = sourced(
        3.0, "nor any that would be so close after this time, s", "chosen: the time of a swerve", ge=0.0, le=60.0
    )
    lane_margin_m: float = sourced(
        0.1,
        "without a free lane beside, the vehicle's middle stays this far within its lane, m",
        "chosen: about a wheel on the line",
        ge=0.0,
        le=2.0,
    )
    inattentive_share: float = sourced(
        0.6,
        "share of drivers behind a vehicle that brakes hard or cuts in who look away at that moment",
        "chosen: conflicts are what is simulated here",
        ge=0.0,
        le=1.0,
    )
    follower_s: float = sourced(
        2.5, "only drivers this close behind, as time gap, s", "chosen: others have time", ge=0.0, le=10.0
    )


class LaneChangeCommandSettings(Settings):
    """A commanded lane change to where nobody has to slow down, when SUMO finds the gaps safe."""

    clear_s: float = sourced(
        10.0,
        "only where nobody in the next lane comes closer than headway_s within this time, s; 0: anywhere",
        "chosen: as long as an overtake takes",
        ge=0.0,
        le=120.0,
    )
    headway_s: float = sourced(1.0, "that distance as time gap, s", "chosen: most drivers keep more", ge=0.0, le=10.0)
    patience_s: float = sourced(
        8.0, "given up when not across after this time, s", "measured: 70 of 79 done within 6 s", gt=0.0, le=60.0
    )


class OvertakeCommandSettings(Settings):
    """A commanded overtake: pull out to the faster side, pass the vehicle ahead, return ahead of it."""

    headway_s: Annotated[Range, within(0.1, 10.0)] = sourced(
        (0.8, 2.5), "gap to the vehicle ahead at the start, in time, s", "chosen: close enough to want to pass"
    )
    surplus_mps: Annotated[Range, within(0.0, 30.0)] = sourced(
        (5.0, 9.0), "desired speed above that of the vehicle ahead, m/s", "chosen: passing takes a few seconds"
    )
    largest_gain: float = sourced(
        1.35,
        "the overtaking driver's desired speed grows at most by this factor",
        "chosen: drivers are hurried, not replaced",
        ge=1.0,
        le=3.0,
    )
    speed_up_s: float = sourced(
        2.0, "time over which the desired speed grows, s", "chosen: no jump in acceleration", ge=0.0, le=30.0
    )
    clearance_m: Annotated[Range, within(0.0, 200.0)] = sourced(
        (8.0, 22.0), "gap behind the rear at which the return begins, m", "measured: 57 of 93 completed in traffic"
    )
    pull_out_s: float = sourced(
        8.0, "given up when not pulled out after this time, s", "chosen: as for lane changes", gt=0.0, le=60.0
    )
    pass_s: float = sourced(
        25.0, "given up when not passed after this time, s", "chosen: overtakes take 10 to 20 s", gt=0.0, le=120.0
    )
    return_s: float = sourced(
        12.0, "given up when not returned after this time, s", "chosen: longer than pulling out", gt=0.0, le=60.0
    )


class SwerveCommandSettings(Settings):
    """An evasive swerve without a cause: aside within the lane, and back."""

    least_speed_mps: float = sourced(
        10.0, "only faster vehicles swerve, m/s", "chosen: below, drivers brake instead", ge=0.0, le=60.0
    )
    offset_m: Annotated[Range, within(0.1, 5.0)] = sourced(
        (0.9, 1.7), "how far aside, m", "measured: 0.9 to 1.7 m are driven without a jump"
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = sourced(
        (4.0, 7.0), "largest lateral acceleration that is meant, m/s2", "driving experiments: 0.3 to 0.7 g"
    )
    hold_s: Annotated[Range, within(0.0, 10.0)] = sourced(
        (0.0, 0.8), "time aside before moving back, s", "chosen: out and back in one motion"
    )


class SlowVehicleCommandSettings(Settings):
    """A disturbance: a vehicle slows down gently and stays slow for a while."""

    least_speed_mps: float = sourced(
        15.0, "only faster vehicles slow down, m/s", "chosen: slower ones disturb already", ge=0.0, le=60.0
    )
    speed_share: Annotated[Range, within(0.1, 1.0)] = sourced(
        (0.65, 0.8), "speed while slow, as a share of the speed before", "measured: others overtake vehicles this slow"
    )
    slow_s: Annotated[Range, within(0.0, 600.0)] = sourced(
        (20.0, 40.0), "time at that speed, s", "chosen: longer than an overtake of 10 to 20 s"
    )
    deceleration_mps2: float = sourced(1.0, "deceleration, m/s2", "chosen: far from a hard brake", ge=0.1, le=10.0)
    jerk_mps3: float = sourced(
        1.0, "jerk into and out of the deceleration, m/s3", "chosen: gentle", ge=0.1, le=LARGEST_MPS3
    )
    recover_s: float = sourced(
        8.0, "time over which the desired speed comes back, s", "chosen: gentle", ge=0.0, le=60.0
    )


class StopInLaneCommandSettings(Settings):
    """A disturbance: a vehicle stops in its lane, stands, and drives on."""

    stand_s: Annotated[Range, within(0.0, 600.0)] = sourced(
        (15.0, 40.0), "time at a standstill, s", "chosen: others get past before a queue forms"
    )
    deceleration_mps2: float = sourced(
        2.5, "deceleration to a standstill, m/s2", "chosen: comfortable, no hard brake", ge=0.1, le=10.0
    )
    jerk_mps3: float = sourced(
        5.0, "jerk into and out of the deceleration, m/s3", "chosen: comfortable", ge=0.1, le=LARGEST_MPS3
    )


class CutInCommandSettings(Settings):
    """A disturbance: a lane change close in front of a vehicle, which has to brake."""

    least_speed_mps: float = sourced(8.0, "only faster vehicles cut in, m/s", "chosen: no queues", ge=0.0, le=60.0)
    gap_m: Annotated[Range, within(0.0, 200.0)] = sourced(
        (6.0, 20.0), "smaller of the gaps ahead and behind in the next lane, m", "chosen: tight, but no collision"
    )
    patience_s: float = sourced(
        5.0, "given up when not across after this time, s", "chosen: the gap does not stay", gt=0.0, le=60.0
    )


class ClosedRampEndCommandSettings(Settings):
    """A disturbance: a vehicle stops, as `StopInLaneCommandSettings` says, before the end of a lane that ends."""

    before_end_share: Annotated[Range, within(0.0, 1.0)] = sourced(
        (0.05, 0.5),
        "where it stops: distance to the lane's end, as a share of reach_m",
        "chosen: an end that is closed early",
    )
    reach_m: float = sourced(
        250.0, "length of the lane's last part, or the lane if shorter, m", "chosen: a usual ramp", gt=0.0, le=5000.0
    )
    stand_s: Annotated[Range, within(0.0, 600.0)] = sourced(
        (20.0, 60.0), "time at a standstill, s", "chosen: several vehicles have to merge before it"
    )
    patience_s: float = sourced(
        30.0, "given up when not braking after this time, s", "chosen: a ramp is driven in less", gt=0.0, le=300.0
    )
