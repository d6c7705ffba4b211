"""The state that a connected vehicle reports of itself: its motion with the noise of its own sensors."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings


def report(state: Array, settings: ReportSettings, key: tuple[str | int, ...]) -> Array:
    """Return what the UV reports of its own state: the truth with white Gaussian noise, (6, n).

    state: true state, (6, n), m, m/s and m/s2. settings: standard deviations of the noise. key: names the draw.
    """
    return state + report_noise(state.shape[1], settings, key)


def report_noise(count: int, settings: ReportSettings, key: tuple[str | int, ...]) -> Array:
    """Noise of a UV's `count` reports, (6, count). key: as in `report`; the same key gives the same noise."""
    sd = np.repeat([settings.position_sd_m, settings.speed_sd_mps, settings.acceleration_sd_mps2], 2)
    return np.asarray(stream("report", *key).standard_normal((6, count)) * sd[:, None])


class ReportSettings(Settings):
    """How well the UV knows its own state: white Gaussian noise on each axis of what it reports.

    The defaults are those of a UV with satellite positioning corrected in real time (RTK) and an inertial sensor:
    position and speed as data sheets of two-band RTK receivers such as u-blox' ZED-F9P give them (0.01 m and 1 ppm of
    the distance to the reference station; 0.05 m/s), acceleration as the step in which cooperative awareness messages
    report it (ETSI TS 102 894-2, 0.1 m/s2).
    """

    position_sd_m: float = Field(0.02, ge=0.0, le=100.0, description="standard deviation of x and of y")
    speed_sd_mps: float = Field(0.05, ge=0.0, le=100.0, description="standard deviation of vx and of vy")
    acceleration_sd_mps2: float = Field(0.1, ge=0.0, le=100.0, description="standard deviation of ax and of ay")
