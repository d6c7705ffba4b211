"""What commanded maneuvers are drawn from: a settings section for each, with the source of every default.

A range is drawn from evenly, anew for each command. A single value is a limit or a constant. docs/traffic.md lists them
beside the thresholds that labels ask for.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, ValidatorFunctionWrapHandler, WrapValidator

from isacsim.settings import Settings
from isacsim.traffic.vehicle_control import LARGEST_MPS3

Range = tuple[float, float]
"""The low and the high end of a range, in the unit at the end of the setting's name."""


def within(least: float, most: float) -> WrapValidator:
    """Return a validator of a range: low <= high, both between least and most."""

    def check(value: Any, parse: ValidatorFunctionWrapHandler) -> Range:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError("must be a range [low, high]")
        low, high = parse(value)
        if low > high:
            raise ValueError("must be a range [low, high] with low <= high")
        if low < least or high > most:
            raise ValueError(f"must be a range [low, high] between {least:g} and {most:g}")
        return low, high

    return WrapValidator(check)


def _setting(
    default: Any,
    description: str,
    source: str,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
) -> Any:
    """A field whose default names its source: a publication, a measurement, or "chosen: why"."""
    return Field(default, description=description, json_schema_extra={"source": source}, ge=ge, gt=gt, le=le)


class BrakeCommandSettings(Settings):
    """A commanded hard brake: deceleration rises, is held, falls, and the driver takes over again."""

    least_speed_mps: float = _setting(
        14.0, "only faster vehicles brake, m/s", "chosen: below, most brakes would be cut at floor_mps", ge=0.0, le=60.0
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = _setting(
        (4.8, 8.0),
        "largest deceleration, m/s2",
        "chosen: from about the 5 m/s² that UN R157 calls an emergency to a full brake on a dry road",
    )
    rise_mps3: Annotated[Range, within(0.5, LARGEST_MPS3)] = _setting(
        (10.0, 18.0), "jerk into the peak, m/s3", "chosen: the peak is reached within 0.3 to 0.8 s"
    )
    hold_s: Annotated[Range, within(0.0, 30.0)] = _setting(
        (0.6, 1.6), "time at the peak, s", "chosen: brakes of 1.3 to 3.7 s in all"
    )
    fall_mps3: Annotated[Range, within(0.5, LARGEST_MPS3)] = _setting(
        (6.0, 12.0), "jerk out of the peak, m/s3", "chosen: drivers let go more slowly than they brake"
    )
    floor_mps: float = _setting(
        5.0, "the command ends at this speed, m/s", "chosen: the vehicle keeps moving", ge=0.0, le=60.0
    )


class AccelCommandSettings(Settings):
    """A commanded hard acceleration, only into a gap that is long enough."""

    least_speed_mps: float = _setting(
        5.0, "only faster vehicles accelerate, m/s", "chosen: no starts from a standstill", ge=0.0, le=60.0
    )
    clear_ahead_m: float = _setting(
        20.0, "gap to the vehicle ahead at a standstill, m", "chosen: room to gain speed in", ge=0.0, le=1000.0
    )
    clear_ahead_s: float = _setting(
        1.2, "added to that gap for each m/s of speed, s", "chosen: a usual headway remains", ge=0.0, le=60.0
    )
    fast_mps: float = _setting(
        25.0,
        "from this speed on, fast_peak_mps2 replaces peak_mps2, m/s",
        "chosen: engines give less at speed",
        ge=0.0,
        le=60.0,
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = _setting(
        (3.0, 4.5),
        "largest acceleration below fast_mps, m/s2",
        "chosen: around the 3.6 m/s² of studies of driving style",
    )
    fast_peak_mps2: Annotated[Range, within(0.5, 10.0)] = _setting(
        (2.8, 3.5), "largest acceleration from fast_mps on, m/s2", "chosen: engines give less at speed"
    )
    rise_mps3: Annotated[Range, within(0.5, LARGEST_MPS3)] = _setting(
        (5.0, 10.0), "jerk into the peak, m/s3", "chosen: the peak is reached within 0.3 to 0.9 s"
    )
    hold_s: Annotated[Range, within(0.0, 30.0)] = _setting(
        (1.4, 2.6), "time at the peak, s", "chosen: the speed grows by 5 to 16 m/s in all"
    )
    fall_mps3: Annotated[Range, within(0.5, LARGEST_MPS3)] = _setting(
        (4.0, 8.0), "jerk out of the peak, m/s3", "chosen: drivers ease off gently"
    )
    top_mps: float = _setting(
        44.0,
        "the command ends at this speed, m/s",
        "chosen: faster than any bundled driver wants to be",
        ge=0.0,
        le=100.0,
    )
    closing_per_s: float = _setting(
        0.05,
        "speed above the vehicle ahead, m/s for each metre of the gap beyond clear_ahead_s, 1/s",
        "chosen: the driver can close in afterwards without braking hard",
        gt=0.0,
        le=10.0,
    )
    least_at_peak_s: float = _setting(
        1.7,
        "speed gain that neither limit cuts, as time at the peak, s",
        "chosen: a shorter gain is no maneuver",
        ge=0.0,
        le=30.0,
    )


class LaneChangeCommandSettings(Settings):
    """A commanded lane change, when SUMO finds the gaps safe."""

    patience_s: float = _setting(
        8.0, "given up when not across after this time, s", "measured: 70 of 79 done within 6 s", gt=0.0, le=60.0
    )


class OvertakeCommandSettings(Settings):
    """A commanded overtake: pull out to the faster side, pass the vehicle ahead, return ahead of it."""

    headway_s: Annotated[Range, within(0.1, 10.0)] = _setting(
        (0.8, 2.5), "gap to the vehicle ahead at the start, in time, s", "chosen: close enough to want to pass"
    )
    surplus_mps: Annotated[Range, within(0.0, 30.0)] = _setting(
        (5.0, 9.0), "desired speed above that of the vehicle ahead, m/s", "chosen: passing takes a few seconds"
    )
    largest_gain: float = _setting(
        1.35,
        "the overtaking driver's desired speed grows at most by this factor",
        "chosen: drivers are hurried, not replaced",
        ge=1.0,
        le=3.0,
    )
    speed_up_s: float = _setting(
        2.0, "time over which the desired speed grows, s", "chosen: no jump in acceleration", ge=0.0, le=30.0
    )
    clearance_m: Annotated[Range, within(0.0, 200.0)] = _setting(
        (8.0, 22.0), "gap behind the rear at which the return begins, m", "measured: 57 of 93 completed in traffic"
    )
    pull_out_s: float = _setting(
        8.0, "given up when not pulled out after this time, s", "chosen: as for lane changes", gt=0.0, le=60.0
    )
    pass_s: float = _setting(
        25.0, "given up when not passed after this time, s", "chosen: overtakes take 10 to 20 s", gt=0.0, le=120.0
    )
    return_s: float = _setting(
        12.0, "given up when not returned after this time, s", "chosen: longer than pulling out", gt=0.0, le=60.0
    )


class SwerveCommandSettings(Settings):
    """A commanded evasive swerve: aside within the lane, and back, behind a vehicle ahead."""

    least_speed_mps: float = _setting(
        10.0, "only faster vehicles swerve, m/s", "chosen: below, drivers brake instead", ge=0.0, le=60.0
    )
    threat_within_m: float = _setting(
        90.0, "only behind a vehicle within this gap, m", "chosen: something to evade", gt=0.0, le=1000.0
    )
    clear_beside_m: float = _setting(
        15.0, "only to a side without vehicles this far ahead and behind, m", "chosen: no side contacts", ge=0.0, le=500
    )
    offset_m: Annotated[Range, within(0.1, 5.0)] = _setting(
        (1.0, 1.7), "how far aside, m", "measured: 0.9 to 1.7 m are driven without a jump"
    )
    lane_margin_m: float = _setting(
        0.1,
        "the vehicle's middle would stay this far within a lane that it drives in the middle of, m",
        "chosen: a swerve is no lane change",
        ge=0.0,
        le=2.0,
    )
    peak_mps2: Annotated[Range, within(0.5, 10.0)] = _setting(
        (4.5, 6.0), "largest lateral acceleration, m/s2", "driving experiments: 0.3 to 0.7 g"
    )
    hold_s: Annotated[Range, within(0.0, 10.0)] = _setting(
        (0.0, 0.6), "time aside before moving back, s", "chosen: out and back in one motion"
    )


class SlowVehicleCommandSettings(Settings):
    """A disturbance: a vehicle slows down gently and stays slow for a while."""

    least_speed_mps: float = _setting(
        15.0, "only faster vehicles slow down, m/s", "chosen: slower ones disturb already", ge=0.0, le=60.0
    )
    speed_share: Annotated[Range, within(0.1, 1.0)] = _setting(
        (0.65, 0.8), "speed while slow, as a share of the speed before", "measured: others overtake vehicles this slow"
    )
    slow_s: Annotated[Range, within(0.0, 600.0)] = _setting(
        (20.0, 40.0), "time at that speed, s", "chosen: longer than an overtake of 10 to 20 s"
    )
    deceleration_mps2: float = _setting(1.0, "deceleration, m/s2", "chosen: far from a hard brake", ge=0.1, le=10.0)
    jerk_mps3: float = _setting(
        1.0, "jerk into and out of the deceleration, m/s3", "chosen: gentle", ge=0.1, le=LARGEST_MPS3
    )
    recover_s: float = _setting(
        8.0, "time over which the desired speed comes back, s", "chosen: gentle", ge=0.0, le=60.0
    )


class StopInLaneCommandSettings(Settings):
    """A disturbance: a vehicle stops in its lane, stands, and drives on."""

    stand_s: Annotated[Range, within(0.0, 600.0)] = _setting(
        (15.0, 40.0), "time at a standstill, s", "chosen: others get past before a queue forms"
    )
    deceleration_mps2: float = _setting(
        2.5, "deceleration to a standstill, m/s2", "chosen: comfortable, no hard brake", ge=0.1, le=10.0
    )
    jerk_mps3: float = _setting(
        5.0, "jerk into and out of the deceleration, m/s3", "chosen: comfortable", ge=0.1, le=LARGEST_MPS3
    )


class CutInCommandSettings(Settings):
    """A disturbance: a lane change close in front of a vehicle, which has to brake."""

    least_speed_mps: float = _setting(8.0, "only faster vehicles cut in, m/s", "chosen: no queues", ge=0.0, le=60.0)
    gap_m: Annotated[Range, within(0.0, 200.0)] = _setting(
        (6.0, 20.0), "smaller of the gaps ahead and behind in the next lane, m", "chosen: tight, but no collision"
    )
    patience_s: float = _setting(
        5.0, "given up when not across after this time, s", "chosen: the gap does not stay", gt=0.0, le=60.0
    )


class ClosedRampEndCommandSettings(Settings):
    """A disturbance: a vehicle stops, as `StopInLaneCommandSettings` says, before the end of a lane that ends."""

    before_end_share: Annotated[Range, within(0.0, 1.0)] = _setting(
        (0.05, 0.5),
        "where it stops: distance to the lane's end, as a share of reach_m",
        "chosen: an end that is closed early",
    )
    reach_m: float = _setting(
        250.0, "length of the lane's last part, or the lane if shorter, m", "chosen: a usual ramp", gt=0.0, le=5000.0
    )
    stand_s: Annotated[Range, within(0.0, 600.0)] = _setting(
        (20.0, 60.0), "time at a standstill, s", "chosen: several vehicles have to merge before it"
    )
    patience_s: float = _setting(
        30.0, "given up when not braking after this time, s", "chosen: a ramp is driven in less", gt=0.0, le=300.0
    )
