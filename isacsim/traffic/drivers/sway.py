"""How drivers wander within their lane.

SUMO's vehicles drive exactly in the middle of their lane. People do not: each vehicle of a recording gets a lateral
offset of its own, a random process with the spread and the slowness of people's. It is added to the recorded states, so
that sensing, labels and truth all see it. SUMO itself knows nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from isac_cosim.base.arrays import Array
from isac_cosim.base.seeding import stream
from isac_cosim.base.setting_fields import Range, range_within, sourced
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings, smooth_step

GRID_S = 0.1
"""Interval at which the process is drawn, s; splines lead from one value to the next."""
ROOM_SHARE = 0.4
"""Largest standard deviation, as a share of the room on one side of the vehicle within its lane."""
MARKING_STEP_M = 0.5
"""Where the offset from the lane's middle steps by more, the vehicle crosses a marking, m."""


class SwaySettings(Settings):
    """The lateral offset of a vehicle within its lane: noise through two lags (an Ornstein-Uhlenbeck process and a
    first-order lag), whose path is as smooth as a steered vehicle's.
    """

    sd_m: Annotated[Range, range_within(0.0, 1.0)] = sourced(
        (0.1, 0.28), "standard deviation of one driver's offset, m; 0 to 0: no sway",
        "published: standard deviation of lateral position in normal driving about 0.2 m (Verster and Roth 2011)",
    )  # fmt: skip
    wander_s: float = sourced(4.0, "correlation time, s", "chosen: some seconds", ge=0.1, le=60.0)
    steering_s: float = sourced(
        1.5, "time in which steering corrects, s", "chosen: lateral speeds of about 0.08 m/s", ge=0.1, le=60.0
    )
    full_mps: float = sourced(
        5.0,
        "speed from which a vehicle sways fully; a slower one less, m/s",
        "chosen: none stands and sways",
        gt=0.0,
        le=1e3,
    )
    change_s: float = sourced(
        2.5, "time before and after crossing a marking in which the sway fades, s",
        "chosen: as long as half a change", gt=0.0, le=60.0,
    )  # fmt: skip

    @property
    def lags_s(self) -> tuple[float, float]:
        """The two lags of `wandering`, s."""
        return self.wander_s, self.steering_s


def add_sway(
    tracks: Iterable[Track],
    lanes: tuple[Lane, ...],
    step_s: float,
    settings: SwaySettings,
    lefthand: bool,
    *key: str | int,
) -> None:
    """Move the states of tracks sideways, in place.

    lefthand: whether traffic keeps left, whose sway is the mirror image. key: names the random draws, with each
    vehicle's id. Equal arguments give equal sway; a vehicle's does not depend on the other vehicles.
    """
    if settings.sd_m[1] == 0.0:
        return
    for track in tracks:
        if len(track) < 2:
            continue
        widths_m = np.array([lane.width_m for lane in lanes])[track.lane]
        offset = sway(track, widths_m, step_s, settings, stream("sway", *key, track.vehicle))
        if lefthand:
            offset = -offset
        sideways = 1j * lane_headings(lanes, track.lane, track.lane_pos) * offset
        track.x[:] += sideways.real
        track.y[:] += sideways.imag
        track.lane_lat[:] += offset


def sway(track: Track, widths_m: Array, step_s: float, settings: SwaySettings, rng: np.random.Generator) -> Array:
    """Return the offset of a vehicle at each row of its track, m, shape (n,), left positive.

    widths_m: of the lane that it drives in, m, shape (n,).
    """
    from scipy.interpolate import CubicSpline  # loaded only here, because it takes a second

    room = np.maximum(0.0, (widths_m - track.width_m) / 2.0)
    sd = np.minimum(float(rng.uniform(*settings.sd_m)), ROOM_SHARE * room)
    if np.ptp(sd) > 0.0:
        # Before a narrow lane, a driver has come to sway less, and after it sways more only by and by.
        reach = 2 * round(settings.change_s / step_s) + 1
        sd = uniform_filter1d(minimum_filter1d(sd, reach, mode="nearest"), reach, mode="nearest")
    # A slow vehicle goes through its sway slowly; one that stands keeps its place.
    passed_s = np.cumsum(np.clip(track.speed / settings.full_mps, 0.0, 1.0)) * step_s
    grid = np.arange(0.0, passed_s[-1] + 2.0 * GRID_S, GRID_S)
    path = CubicSpline(grid, wandering(len(grid), GRID_S, settings.lags_s, rng))(passed_s)
    return np.asarray(sd * path * _away_from_markings(track, step_s, settings.change_s))


def wandering(count: int, step_s: float, lags_s: tuple[float, float], rng: np.random.Generator) -> Array:
    """Return a stationary process of unit variance, shape (count,): noise through two lags, s, that differ."""
    from scipy.signal import lfilter  # loaded only here, because it takes a second

    slow, fast = (float(np.exp(-step_s / lag)) for lag in lags_s)
    settled = round(10.0 * sum(lags_s) / step_s)
    noise = rng.standard_normal(settled + count)
    wander = lfilter([np.sqrt(1.0 - slow**2)], [1.0, -slow], noise)
    steered = lfilter([1.0 - fast], [1.0, -fast], wander)[settled:]
    variance = (1.0 - fast) ** 2 / (1.0 - fast**2) * (1.0 + slow * fast) / (1.0 - slow * fast)
    return np.asarray(steered / np.sqrt(variance))


def _away_from_markings(track: Track, step_s: float, change_s: float) -> Array:
    """Return a factor that fades to 0 where the vehicle crosses a marking, 1 elsewhere, shape (n,)."""
    factor = np.ones(len(track))
    rows = np.arange(len(track))
    for row in np.flatnonzero(np.abs(np.diff(track.lane_lat)) > MARKING_STEP_M) + 1:
        factor *= smooth_step(np.clip(np.abs(rows - row + 0.5) * step_s / change_s, 0.0, 1.0))
    return factor
