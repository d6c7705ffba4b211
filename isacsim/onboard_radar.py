"""The other sensor: the UV's own 77 GHz radar, which sees the TV from where the UV is.

A radar cycle gives range, azimuth and radial speed relative to the UV; with the UV's own state these become a fix of
the TV, and the same Kalman filter as behind the sites makes a 6 x S state of the fixes, predicting between the cycles.
Across the line of sight the speed is not measured; the filter learns it from the positions.

Source of the defaults: the class of long-range radars such as Continental's ARS 408 (250 m, 72 ms, 0.4 m, 0.1 km/h,
azimuth 0.1 to 1 degree by direction).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from isacsim.arrays import Array, BoolArray
from isacsim.errors import InputError
from isacsim.panels import Panels
from isacsim.radio.blockage import Blockers, hides
from isacsim.radio.channel import rain_db_per_km
from isacsim.seeding import stream
from isacsim.sensing import SensedRecord, before, filled, prelude_snapshots
from isacsim.settings import Settings
from isacsim.tracking.fusion import Fixes, checked
from isacsim.tracking.kalman import TrackingSettings, track


class RadarSettings(Settings):
    """The onboard radar and what stands in its way."""

    carrier_hz: float = Field(77e9, gt=0, description="Carrier frequency.")
    cycle_s: float = Field(0.072, gt=0, description="Time between measurements.")
    range_m: float = Field(250.0, gt=0, description="Range at which detection succeeds half the time in clear air.")
    half_width_deg: float = Field(
        180.0,
        gt=0,
        le=180,
        description="Field of view to either side of the UV's heading; 180 stands for radars all round.",
    )
    range_sd_m: float = Field(0.4, gt=0, description="Accuracy of range of a strong echo.")
    speed_sd_mps: float = Field(0.1 / 3.6, gt=0, description="Accuracy of radial speed of a strong echo.")
    azimuth_sd_deg: float = Field(0.3, gt=0, description="Accuracy of azimuth of a strong echo.")
    strong_snr_db: float = Field(
        25.0, description="SNR from which the accuracies hold; below it they grow with the root of the noise."
    )
    false_alarm: float = Field(
        1e-6, gt=0, lt=1, description="False alarm probability that sets the detection threshold."
    )
    condition: Literal["clear", "nlos", "weather"] = Field(
        "clear",
        description="Clear; the line of sight lost for part of the record; adverse weather (Cases 3-5 of ASI-BIP).",
    )
    dropped: float = Field(0.75, ge=0, lt=1, description="Share of the record's cycles lost under `nlos`.")
    pattern: Literal["random", "contiguous", "line_of_sight"] = Field(
        "random", description="Which cycles `nlos` loses: any, one stretch, or those in which a vehicle stands between."
    )
    weather_loss_db: float = Field(20.0, ge=0, description="Echo loss of `weather`.")
    rain_mm_per_h: float = Field(0.0, ge=0, le=300, description="Rain, besides (ITU-R P.838-3).")
    height_m: float = Field(0.5, ge=0, description="Height of the radar above the road.")
    target_height_m: float = Field(0.8, ge=0, description="Height of the target's reflecting point.")
    weather_dropped: float = Field(
        0.3, ge=0, lt=1, description="Share of cycles that `weather` loses besides, at random."
    )
    tracking: TrackingSettings = Field(
        default_factory=lambda: TrackingSettings(jerk_density=1.0, prelude_s=2.0),
        description="The filter behind the radar.",
    )


@dataclass(frozen=True)
class Carrier:
    """Motion of the UVs of B records: x, y, vx, vy, ax, ay, m, m/s, m/s2, (B, 6, C) at rate_hz."""

    state: Array
    rate_hz: float


@dataclass(frozen=True)
class Scan:
    """Fixes of one record at every snapshot, most of them not valid (S); mean SNR, dB; share of the cycles detected."""

    fixes: Fixes
    snr_db: float
    detected: float


def sense_onboard(
    truth: Array,
    rate_hz: float,
    carrier: Carrier,
    settings: RadarSettings,
    keys: Sequence[tuple[str | int, ...]],
    blockers: Sequence[Blockers | None] | None = None,
) -> list[SensedRecord]:
    """Sense B records from their UVs; the counterpart of `sensing.sense`.

    truth: of the TVs, (B, 6, S) at rate_hz. blockers: vehicles other than the two, for pattern
    `line_of_sight`. The cycles before the record begins are never dropped: the target had been tracked
    before it was lost.
    A record with no detection before it begins is not usable.
    Raises InputError where the arguments do not fit together.
    """
    if truth.ndim != 3 or len(truth) != len(keys) or len(carrier.state) != len(keys):
        raise InputError(
            f"{len(truth)} targets, {len(carrier.state)} carriers and {len(keys)} keys: give one of each a record"
        )
    count = prelude_snapshots(rate_hz, settings.tracking)
    motion = np.concatenate([before(truth, rate_hz, count), truth], axis=2)
    if settings.condition == "nlos" and settings.pattern == "line_of_sight" and blockers is None:
        raise InputError(
            "pattern line_of_sight asks for the other vehicles, which were not given: choose random or contiguous"
        )
    others = blockers if blockers is not None else [None] * len(keys)
    time_s = (np.arange(motion.shape[2]) - count) / rate_hz
    scans = [
        _scan(motion[k], time_s, _carried(carrier, k, time_s), settings, key, others[k]) for k, key in enumerate(keys)
    ]
    begun = [filled(scan.fixes) for scan in scans]
    tracks = track(
        np.stack([f.state for f in begun]),
        np.stack([f.covariance for f in begun]),
        np.stack([f.valid for f in begun]),
        1 / rate_hz,
        settings.tracking,
    )
    return [
        SensedRecord(
            state=np.ascontiguousarray(tracks.state[k, count:].T),
            fixes=np.ascontiguousarray(begun[k].state[count:].T),
            n_sites=1,
            snr_db=scans[k].snr_db,
            detected=scans[k].detected,
            usable=bool(begun[k].valid[: count + 1].any()),
        )
        for k in range(len(keys))
    ]


def _carried(carrier: Carrier, record: int, time_s: Array) -> Array:
    """Position and velocity of one UV at each instant, (4, S): interpolated, carried back before the record."""
    state = carrier.state[record]
    known = np.arange(state.shape[1]) / carrier.rate_hz
    early = np.minimum(time_s, 0.0)
    position = [
        np.interp(time_s, known, state[k]) + state[k + 2, 0] * early + state[k + 4, 0] * early**2 / 2 for k in (0, 1)
    ]
    velocity = [np.interp(time_s, known, state[k]) + state[k + 2, 0] * early for k in (2, 3)]
    return np.stack(position + velocity)


def _scan(
    motion: Array,
    time_s: Array,
    own: Array,
    settings: RadarSettings,
    key: tuple[str | int, ...],
    blockers: Blockers | None,
) -> Scan:
    """Radar cycles of one record. motion: of the TV, (6, S); own: of the UV, (4, S); both at time_s, (S,)."""
    rng = stream(*key, "radar")
    step_s = time_s[1] - time_s[0]
    at = np.round(np.arange(rng.random() * settings.cycle_s, time_s[-1] - time_s[0], settings.cycle_s) / step_s).astype(
        int
    )
    target, radar = motion[:4, at], own[:, at]
    offset = target[:2] - radar[:2]
    ground = np.hypot(*offset)
    drop = settings.target_height_m - settings.height_m
    distance = np.hypot(ground, drop)
    snr = _snr(distance, settings)
    seen = _in_view(offset, radar, settings) & (rng.random(len(at)) < settings.false_alarm ** (1 / (1 + snr)))
    seen &= ~_lost(time_s[at], target, radar, settings, blockers, rng)
    coarser = np.sqrt(np.maximum(10 ** (settings.strong_snr_db / 10) / snr, 1.0))
    deviation = coarser * np.array(
        [[settings.range_sd_m], [settings.speed_sd_mps], [np.radians(settings.azimuth_sd_deg)]]
    )
    noise = rng.standard_normal((3, len(at))) * deviation
    speed = ((target[2:] - radar[2:]) * offset).sum(axis=0) / distance
    state, covariance = _to_plane(
        distance + noise[0], speed + noise[1], np.arctan2(offset[1], offset[0]) + noise[2], drop, radar, deviation
    )
    fixes = Fixes(
        np.zeros((len(time_s), 4)), np.tile(1e8 * np.eye(4), (len(time_s), 1, 1)), np.zeros(len(time_s), bool)
    )
    fixes.state[at], fixes.covariance[at], fixes.valid[at] = state, covariance, seen
    in_record = time_s[at] >= 0
    share = float(seen[in_record].mean()) if in_record.any() else 0.0
    return Scan(checked(fixes.state, fixes.covariance, fixes.valid), float(10 * np.log10(snr).mean()), share)


def _snr(distance: Array, settings: RadarSettings) -> Array:
    """SNR of a detection, linear: the radar equation through one half detected at range_m (Swerling 1)."""
    at_limit = np.log(settings.false_alarm) / np.log(0.5) - 1
    loss_db = settings.weather_loss_db if settings.condition == "weather" else 0.0
    rain_db = rain_db_per_km(settings.carrier_hz, settings.rain_mm_per_h) if settings.rain_mm_per_h else 0.0
    return np.asarray(
        at_limit * (settings.range_m / distance) ** 4 * 10 ** (-(loss_db + 2 * distance / 1000 * rain_db) / 10)
    )


def _in_view(offset: Array, radar: Array, settings: RadarSettings) -> BoolArray:
    """Whether the target lies within the field of view about the UV's direction of travel."""
    bearing = np.arctan2(offset[1], offset[0]) - np.arctan2(radar[3], radar[2])
    return np.asarray(np.cos(bearing) >= np.cos(np.radians(settings.half_width_deg)) - 1e-12)


def _lost(
    time_s: Array,
    target: Array,
    radar: Array,
    settings: RadarSettings,
    blockers: Blockers | None,
    rng: np.random.Generator,
) -> BoolArray:
    """Cycles that the condition takes away; never one before the record begins."""
    lost = np.zeros(len(time_s), dtype=bool)
    inside = np.flatnonzero(time_s >= 0)
    if settings.condition == "weather":
        lost[inside] = rng.random(len(inside)) < settings.weather_dropped
    elif settings.condition == "nlos" and settings.pattern == "line_of_sight" and blockers is not None:
        size = (len(time_s), 1)
        flat = np.zeros((*size, 2))
        rise = np.full(size, settings.height_m - settings.target_height_m)
        eye = Panels(radar[0][:, None], radar[1][:, None], rise, flat, flat, settings.target_height_m)
        lost[inside] = hides(blockers, target[:2].T, eye, time_s)[inside, 0]
    elif settings.condition == "nlos":
        number = round(settings.dropped * len(inside))
        if settings.pattern == "random":
            lost[rng.choice(inside, number, replace=False)] = True
        else:
            begin = int(rng.integers(len(inside) - number + 1))
            lost[inside[begin : begin + number]] = True
    return lost


def _to_plane(
    distance: Array, speed: Array, bearing: Array, drop: float, radar: Array, deviation: Array
) -> tuple[Array, Array]:
    """Fixes of the target in the plane, (n, 4), and their covariances, (n, 4, 4), from relative measurements.

    The speed across the line of sight is not measured: it is given as zero, with a deviation of 60 m/s. An azimuth
    error turns the UV's own velocity across the line of sight into an error of the speed along it.
    """
    ground = np.sqrt(np.maximum(distance**2 - drop**2, 0.01))
    along = np.stack([np.cos(bearing), np.sin(bearing)])
    across = np.stack([-along[1], along[0]])
    radial = speed * distance / ground + (radar[2:] * along).sum(axis=0)
    state = np.concatenate([radar[:2] + ground * along, radial * along])
    range_sd, speed_sd, azimuth_sd = deviation
    speed_variance = speed_sd**2 + ((radar[2:] * across).sum(axis=0) * azimuth_sd) ** 2
    covariance = np.zeros((len(distance), 4, 4))
    covariance[:, :2, :2] = _turned(along, across, range_sd**2, (ground * azimuth_sd) ** 2)
    covariance[:, 2:, 2:] = _turned(along, across, speed_variance, np.full(len(distance), 60.0**2))
    return state.T, covariance


def _turned(along: Array, across: Array, first: Array, second: Array) -> Array:
    """Covariance with variances `first` along and `second` across, in the plane's axes, (n, 2, 2)."""
    return np.asarray(
        np.einsum("an,bn,n->nab", along, along, first) + np.einsum("an,bn,n->nab", across, across, second)
    )
