"""The onboard radar: the UV's own 77 GHz radar, which senses the TV from where the UV is.

A radar cycle measures range, azimuth and radial speed relative to the UV. With the position and velocity that the UV
reports of itself, these make a fix of the TV. The Kalman filter that also follows the sites' fixes turns them into
states, and predicts between the cycles. The radar does not measure the speed across the line of sight; the filter
learns it from the positions.

Source of the defaults: long-range radars of the class of Continental's ARS 408 (250 m, 72 ms, 0.4 m, 0.1 km/h,
azimuth 0.1 to 1 degree, depending on direction). ASI-BIP does not describe its radar; RADAR_PRESETS holds a reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import Blockers, hides
from isac_cosim.isacsim.radio.channel import rain_db_per_km
from isac_cosim.isacsim.sensing.following import before
from isac_cosim.isacsim.sensing.passages import Carrier
from isac_cosim.isacsim.tracking.fusion import Fixes, sound_fixes
from isac_cosim.isacsim.tracking.kalman import TrackingSettings

LONG_RANGE = "long_range"
RADAR_PRESETS: Mapping[str, Mapping[str, float]] = {
    LONG_RANGE: {},
    "framework": {
        "cycle_s": 0.0025,
        "azimuth_sd_deg": 0.2,
        "weather_loss_db": 0.0,
        "weather_dropped": 0.0,
        "weather_factor": 10.0,
    },
}
"""Named radars: what differs from the defaults, which are a usual long-range radar. framework: one reading of ASI-BIP,
which re-implements its baselines "within our uniform simulation framework": at the refresh rate of its sensing, 400 Hz,
with deviations ten times as large where the echo loses 20 dB, and no cycle lost."""
SIDE_DEG = 45.0
"""Angle off boresight from which on the azimuth has the deviation to the side."""
UNKNOWN_SPEED_MPS = 60.0
"""Standard deviation given to the speed across the line of sight, which no cycle measures."""


class RadarSettings(Settings):
    """The onboard radar, and what hinders it."""

    carrier_hz: float = Field(77e9, gt=0, le=1e13, description="Carrier frequency.")
    cycle_s: float = Field(0.072, gt=0, le=1e3, description="Time between measurements.")
    range_m: float = Field(
        250.0, gt=0, le=1e5, description="Range at which detection succeeds half the time in clear air."
    )
    half_width_deg: float = Field(
        180.0,
        gt=0,
        le=180,
        description="Field of view to either side of the UV's heading; 180: radars all round.",
    )
    range_sd_m: float = Field(0.4, gt=0, le=1e3, description="Standard deviation of the range of a strong echo.")
    speed_sd_mps: float = Field(
        0.1 / 3.6, gt=0, le=1e3, description="Standard deviation of the radial speed of a strong echo."
    )
    azimuth_sd_deg: float = Field(
        0.1,
        gt=0,
        le=180,
        description="Standard deviation of the azimuth of a strong echo on boresight, ahead or behind.",
    )
    azimuth_side_sd_deg: float = Field(
        1.0,
        gt=0,
        le=180,
        description=f"The same from {SIDE_DEG:g} degrees off boresight on; linear between. That of azimuth_sd_deg if "
        "only that is given.",
    )
    strong_snr_db: float = Field(
        25.0,
        ge=-60,
        le=200,
        description="SNR above which these deviations hold; below, they grow with the square root of the noise.",
    )
    false_alarm: float = Field(
        1e-6, gt=0, lt=1, description="False alarm probability that sets the detection threshold."
    )
    condition: Literal["clear", "nlos", "weather"] = Field(
        "clear",
        description="clear; nlos: the line of sight is lost for part of the record; weather: adverse weather "
        "(Cases 3-5 of ASI-BIP).",
    )
    dropped: float = Field(0.75, ge=0, lt=1, description="Share of the record's cycles lost under `nlos`.")
    pattern: Literal["random", "contiguous", "line_of_sight"] = Field(
        "random",
        description="Which cycles `nlos` loses: random ones, one stretch, or those in which a vehicle is in between.",
    )
    weather_loss_db: float = Field(20.0, ge=0, le=300, description="Loss of the echo under `weather`.")
    weather_factor: float = Field(
        1.0, ge=1, le=1e3, description="Factor of the deviations under `weather`, besides what its SNR does to them."
    )
    rain_mm_per_h: float = Field(0.0, ge=0, le=300, description="Rain, under any condition (ITU-R P.838-3).")
    height_m: float = Field(0.5, ge=0, le=20, description="Height of the radar above the road.")
    target_height_m: float = Field(0.8, ge=0, le=20, description="Height of the target's reflecting point.")
    weather_dropped: float = Field(
        0.3, ge=0, lt=1, description="Share of the cycles that `weather` loses at random, besides its echo loss."
    )
    tracking: TrackingSettings = Field(
        default_factory=lambda: TrackingSettings(jerk_density=1.0, run_in_s=2.0),
        description="The filter behind the radar.",
    )

    @model_validator(mode="before")
    @classmethod
    def _same_to_every_side(cls, content: Any) -> Any:
        """Give the azimuth one deviation in every direction where only one is given, as earlier versions did."""
        if isinstance(content, Mapping) and "azimuth_sd_deg" in content and "azimuth_side_sd_deg" not in content:
            return {**content, "azimuth_side_sd_deg": content["azimuth_sd_deg"]}
        return content


@dataclass(frozen=True)
class Pose:
    """Where one UV is at each snapshot: true and reported x, y, vx, vy, (4, S), and its true heading, rad, (S,).

    The heading is NaN if the UV never moves. position_sd_m, speed_sd_mps: as in Carrier.
    """

    true: Array
    reported: Array
    heading_rad: Array
    position_sd_m: float = 0.0
    speed_sd_mps: float = 0.0

    @classmethod
    def of(cls, carrier: Carrier, time_s: Array, key: tuple[str | int, ...]) -> Pose:
        """Return the pose of a UV at instants from the passage's start on, s, interpolated between its reports.

        Before that its motion is carried back at constant acceleration, with report errors of its own; its heading
        there is the first that is known. key: seeds these errors.
        """
        count = int(np.ceil(max(0.0, -time_s[0]) * carrier.rate_hz))
        state = carrier.state
        true = np.concatenate([before(state, carrier.rate_hz, count), state], axis=1)[:4]
        reported = state if carrier.reported is None else carrier.reported
        deviation = np.repeat([carrier.position_sd_m, carrier.speed_sd_mps], 2)
        early = stream(*key, "carrier").standard_normal((4, count)) * deviation[:, None]
        error = np.concatenate([early, (reported - state)[:4]], axis=1)
        known = (np.arange(true.shape[1]) - count) / carrier.rate_hz
        heading = heading_rad(state[2:4])
        nearest = np.clip(np.round(time_s * carrier.rate_hz).astype(np.int64), 0, len(heading) - 1)
        return cls(
            true=np.stack([np.interp(time_s, known, row) for row in true]),
            reported=np.stack([np.interp(time_s, known, row) for row in true + error]),
            heading_rad=heading[nearest],
            position_sd_m=carrier.position_sd_m,
            speed_sd_mps=carrier.speed_sd_mps,
        )


@dataclass(frozen=True)
class Scan:
    """One record's fixes at every snapshot (S), most of them not valid; mean SNR, dB; share of the cycles detected."""

    fixes: Fixes
    snr_db: float
    detected: float


def scan(
    motion: Array,
    time_s: Array,
    pose: Pose,
    settings: RadarSettings,
    key: tuple[str | int, ...],
    blockers: Blockers | None,
    whole: bool = True,
) -> Scan:
    """Radar cycles of one passage. motion: of the TV, (6, S), and pose of the UV, both at time_s, (S,).

    The condition takes no cycle before time 0: the target had been tracked before it was lost.
    blockers: the vehicles other than TV and UV, needed for the pattern `line_of_sight`. whole: whether these are all
    cycles of the passage; those of one piece do not know what share of the others is lost.
    Raises InputError if the pattern cannot be had of what is given.
    """
    rng = stream(*key, "radar")
    step_s = time_s[1] - time_s[0]
    cycles_s = np.arange(rng.random() * settings.cycle_s, time_s[-1] - time_s[0], settings.cycle_s)
    at = np.round(cycles_s / step_s).astype(int)
    target, radar, reported = motion[:4, at], pose.true[:, at], pose.reported[:, at]
    offset = target[:2] - radar[:2]
    drop = settings.target_height_m - settings.height_m
    true = Cycles.of(offset, target[2:] - radar[2:], drop)
    snr = _snr(true.distance, settings)
    heading = _known_heading(pose.heading_rad, motion, pose.true, time_s)[at]
    seen = _in_view(true.bearing, heading, settings)
    seen &= rng.random(len(at)) < settings.false_alarm ** (1 / (1 + snr))
    seen &= ~_lost(time_s[at], target, radar, settings, blockers, rng, whole)
    coarser = np.sqrt(np.maximum(10 ** (settings.strong_snr_db / 10) / snr, 1.0))
    if settings.condition == "weather":
        coarser = coarser * settings.weather_factor
    even = np.ones(len(at))
    azimuth_sd = azimuth_deviation(true.bearing - heading, settings)
    deviation = coarser * np.stack([settings.range_sd_m * even, settings.speed_sd_mps * even, azimuth_sd])
    noise = rng.standard_normal((3, len(at))) * deviation
    measured = Cycles(true.distance + noise[0], true.speed + noise[1], true.bearing + noise[2], drop)
    fixes = unseen(len(time_s))
    fixes.state[at], fixes.valid[at] = measured.fix(reported), seen
    fixes.covariance[at] = true.covariance(radar[2:], deviation, pose.position_sd_m, pose.speed_sd_mps)
    in_record = time_s[at] >= 0
    share = float(seen[in_record].mean()) if in_record.any() else 0.0
    return Scan(sound_fixes(fixes.state, fixes.covariance, fixes.valid), float(10 * np.log10(snr).mean()), share)


def azimuth_deviation(off_heading: Array, settings: RadarSettings) -> Array:
    """Return the standard deviation of the azimuth of a strong echo, rad, (n,).

    off_heading: angle from the UV's heading, rad, (n,). Radars all round look ahead and behind: the angle off boresight
    is that from the nearer of both directions.
    """
    ahead, side = settings.azimuth_sd_deg, settings.azimuth_side_sd_deg
    off_deg = np.degrees(np.arcsin(np.abs(np.sin(off_heading))))
    return np.asarray(np.radians(ahead + (side - ahead) * np.minimum(off_deg / SIDE_DEG, 1.0)))


def unseen(count: int) -> Fixes:
    """Return the fixes of a target that no cycle detects."""
    return Fixes(np.zeros((count, 4)), np.tile(1e8 * np.eye(4), (count, 1, 1)), np.zeros(count, bool))


@dataclass(frozen=True)
class Cycles:
    """What n radar cycles measure, true or with noise.

    distance: slant range, m. speed: relative radial speed, m/s. bearing: of the target, rad from +x. All (n,).
    drop: height of the target's reflecting point above the radar, m.
    """

    distance: Array
    speed: Array
    bearing: Array
    drop: float

    @staticmethod
    def of(offset: Array, velocity: Array, drop: float) -> Cycles:
        """The true measurements. offset, velocity: of the target relative to the radar, m, m/s, (2, n)."""
        distance = np.sqrt((offset**2).sum(axis=0) + drop**2)
        return Cycles(distance, (velocity * offset).sum(axis=0) / distance, np.arctan2(offset[1], offset[0]), drop)

    @property
    def ground(self) -> Array:
        """Range over the ground, m, (n,)."""
        return np.asarray(np.sqrt(np.maximum(self.distance**2 - self.drop**2, 0.01)))

    def fix(self, radar: Array) -> Array:
        """Fixes x, y, vx, vy of the target, (n, 4). radar: the UV's x, y, vx, vy, (4, n).

        The speed across the line of sight is not measured and is given as zero.
        """
        along = np.stack([np.cos(self.bearing), np.sin(self.bearing)])
        radial = self.speed * self.distance / self.ground + (radar[2:] * along).sum(axis=0)
        return np.concatenate([radar[:2] + self.ground * along, radial * along]).T

    def covariance(
        self, radar_velocity: Array, deviation: Array, position_sd_m: float = 0.0, speed_sd_mps: float = 0.0
    ) -> Array:
        """Covariance of the fixes about the true state, to first order, (n, 4, 4).

        One error of azimuth both moves the position across the line of sight and turns the line onto which the UV's
        velocity is projected, so position and velocity err together. It is evaluated at the true line of sight, which
        a tracker predicts better than one cycle measures it.

        radar_velocity: the UV's, m/s, (2, n). deviation: of range, radial speed and azimuth, (3, n). position_sd_m,
        speed_sd_mps: of the UV's reports, on either axis; interpolation between reports makes them an upper bound.
        """
        ground = self.ground
        along = np.stack([np.cos(self.bearing), np.sin(self.bearing)])
        across = np.stack([-along[1], along[0]])
        radial = self.speed * self.distance / ground + (radar_velocity * along).sum(axis=0)
        zero = np.zeros_like(along)
        stretch = self.distance / ground
        by_range = np.concatenate([stretch * along, -self.speed * self.drop**2 / ground**3 * along])
        by_speed = np.concatenate([zero, stretch * along])
        by_azimuth = np.concatenate([ground * across, (radar_velocity * across).sum(axis=0) * along + radial * across])
        columns = [column * sd for column, sd in zip((by_range, by_speed, by_azimuth), deviation, strict=True)]
        columns.append(np.concatenate([zero, UNKNOWN_SPEED_MPS * across]))
        columns.append(np.concatenate([zero, speed_sd_mps * along]))
        root = np.stack(columns)
        covariance = np.einsum("kan,kbn->nab", root, root)
        covariance[:, [0, 1], [0, 1]] += position_sd_m**2
        return np.asarray(covariance)


def _snr(distance: Array, settings: RadarSettings) -> Array:
    """SNR of a detection, linear, (n,): the radar equation, with half detected at range_m (Swerling 1)."""
    at_limit = np.log(settings.false_alarm) / np.log(0.5) - 1
    loss_db = settings.weather_loss_db if settings.condition == "weather" else 0.0
    rain_db = rain_db_per_km(settings.carrier_hz, settings.rain_mm_per_h) if settings.rain_mm_per_h else 0.0
    return np.asarray(
        at_limit * (settings.range_m / distance) ** 4 * 10 ** (-(loss_db + 2 * distance / 1000 * rain_db) / 10)
    )


def _known_heading(heading: Array, motion: Array, radar: Array, time_s: Array) -> Array:
    """The UV's heading at each snapshot, (S,); of one that never moves, the direction to the target at record start.

    A UV that stands throughout gives no clue to its heading. One that is paired with a target is assumed to face it:
    a narrow field of view then holds the target when the record begins, and may lose it as the target drives on.
    """
    if not np.isnan(heading).any():
        return heading
    start = min(int(np.searchsorted(time_s, 0.0)), len(time_s) - 1)
    dx, dy = motion[:2, start] - radar[:2, start]
    return np.full(len(time_s), np.arctan2(dy, dx))


def _in_view(bearing: Array, heading: Array, settings: RadarSettings) -> BoolArray:
    """Whether the target lies within the field of view, (n,). bearing, heading: rad from +x, (n,)."""
    return np.asarray(np.cos(bearing - heading) >= np.cos(np.radians(settings.half_width_deg)) - 1e-12)


def _lost(
    time_s: Array,
    target: Array,
    radar: Array,
    settings: RadarSettings,
    blockers: Blockers | None,
    rng: np.random.Generator,
    whole: bool,
) -> BoolArray:
    """Whether the condition takes a cycle away, (n,); never one before the passage begins."""
    lost = np.zeros(len(time_s), dtype=bool)
    inside = np.flatnonzero(time_s >= 0)
    if settings.condition == "clear":
        return lost
    if settings.condition == "weather":
        lost[inside] = rng.random(len(inside)) < settings.weather_dropped
    elif settings.pattern == "line_of_sight":
        if blockers is None:
            raise InputError(
                "pattern line_of_sight needs the other vehicles, which were not given: choose random or contiguous"
            )
        size = (len(time_s), 1)
        flat = np.zeros((*size, 2))
        rise = np.full(size, settings.height_m - settings.target_height_m)
        eye = Panels(radar[0][:, None], radar[1][:, None], rise, flat, flat, settings.target_height_m)
        lost[inside] = hides(blockers, target[:2].T, eye, time_s)[inside, 0]
    elif not whole and settings.pattern == "contiguous":
        raise InputError(
            "pattern contiguous is one stretch of a record, which running traffic has not: choose random or "
            "line_of_sight"
        )
    elif not whole:
        lost[inside] = rng.random(len(inside)) < settings.dropped
    else:
        number = round(settings.dropped * len(inside))
        if settings.pattern == "random":
            lost[rng.choice(inside, number, replace=False)] = True
        else:
            begin = int(rng.integers(len(inside) - number + 1))
            lost[inside[begin : begin + number]] = True
    return lost
