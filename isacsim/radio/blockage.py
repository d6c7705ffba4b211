"""Vehicles between a sensor and its target, and how much they attenuate the echo (3GPP TR 37.885, 6.2.1).

A vehicle blocks if the line of sight passes through its box. The height of the line counts: from a mast, a truck hides
only what is close behind it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.traffic.motion import MotionSettings, positions
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings

CAR_HEIGHT_M = 1.6
TRUCK_HEIGHT_M = 3.0
HIGH_KINDS = ("truck", "trailer", "bus", "coach", "delivery")
"""SUMO vehicle classes that are TRUCK_HEIGHT_M high."""
CAR_KINDS = (
    "passenger", "private", "taxi", "hov", "evehicle", "emergency", "authority", "army", "vip", "ignoring",
    "custom1", "custom2",
)  # fmt: skip
"""SUMO vehicle classes of cars. All other classes are taken for CAR_HEIGHT_M high, too, for want of a better value."""


def height_m(kind: str) -> float:
    """Return how high the vehicles of a SUMO vehicle class are, m."""
    return TRUCK_HEIGHT_M if kind in HIGH_KINDS else CAR_HEIGHT_M


@dataclass(frozen=True)
class Blockers:
    """The other vehicles of one record; column k of every array is begin_s + k * step_s after the record's start.

    ids: names, which seed each vehicle's loss. x, y: front bumper centre, m, (V, K), NaN where absent. heading: unit
    vector of the direction of travel, (V, K, 2). length_m, width_m: (V,). height_m: CAR_HEIGHT_M or TRUCK_HEIGHT_M,
    (V,).
    """

    ids: Sequence[str]
    step_s: float
    x: Array
    y: Array
    heading: Array
    length_m: Array
    width_m: Array
    height_m: Array
    begin_s: float = 0.0

    @classmethod
    def of(
        cls, tracks: Sequence[Track], step_s: float, x: Array, y: Array, heading: Array, begin_s: float = 0.0
    ) -> Blockers:
        """Return the vehicles of some tracks where they are. tracks: V of them, for names and sizes."""
        return cls(
            tuple(track.vehicle for track in tracks),
            step_s,
            x,
            y,
            heading,
            length_m=np.array([track.length_m for track in tracks]),
            width_m=np.array([track.width_m for track in tracks]),
            height_m=np.array([height_m(track.kind) for track in tracks]),
            begin_s=begin_s,
        )


def blockers_of(
    recording: Recording,
    t_start: float,
    t_end: float,
    without: Collection[str],
    motion: MotionSettings,
    every_steps: int = 5,
    run_in_s: float = 0.0,
) -> Blockers:
    """Collect the vehicles of a recording that were on the road between two times (s), except those named.

    without: the target, and for the onboard radar its carrier. motion: how the positions of all vehicles of a record
    are conditioned. every_steps: recording steps between columns; the default is 0.05 s, in which traffic moves 1.5 m.
    run_in_s: how long before t_start the vehicles are collected, too, s.
    """
    first = round((t_start - run_in_s) / recording.step_s)
    steps = np.arange(first, round(t_end / recording.step_s) + 1, every_steps)
    present = {
        name: track
        for name, track in recording.tracks.items()
        if name not in without and track.first_step <= steps[-1] and track.first_step + len(track) > steps[0]
    }
    shape = (len(present), len(steps))
    x, y, heading = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros((*shape, 2))
    for vehicle, track in enumerate(present.values()):
        row = steps - track.first_step
        on_road = (row >= 0) & (row < len(track))
        rows = row[on_road]
        x[vehicle, on_road], y[vehicle, on_road] = positions(recording, track, steps[on_road], motion)
        along = lane_headings(recording.lanes, track.lane[rows], track.lane_pos[rows])
        heading[vehicle, on_road] = np.stack([along.real, along.imag], axis=1)
    return Blockers.of(list(present.values()), every_steps * recording.step_s, x, y, heading, -run_in_s)


def blockage_db(
    blockers: Blockers, position: Array, site: IntArray, panels: Panels, time_s: Array, key: tuple[str | int, ...]
) -> Array:
    """Loss of each echo's path, one way, dB, (S, I): that of the vehicle in between that attenuates most.

    position: of the target, m, (S, 2). site, panels: of each echo, (S, I). time_s: of each snapshot, (S,); before the
    first column, the vehicles are where they are in it. key: names the record and seeds the draws; the loss of
    a vehicle toward a site is drawn once for each record.
    """
    row = _column(blockers, time_s)
    worst = np.zeros(site.shape)
    for vehicle, name in enumerate(blockers.ids):
        hidden = _between(blockers, vehicle, row, position, panels)
        if not hidden.any():
            continue
        _, _, distance = panels.sight(position[:, :1], position[:, 1:])
        low, top = _ends(panels)
        mean, deviation = mean_loss_db(distance, low, top, float(blockers.height_m[vehicle]))
        for number in np.unique(site[hidden]):
            draw = stream(*key, "blockage", int(number), name).standard_normal()
            of_site = hidden & (site == number)
            worst[of_site] = np.maximum(worst[of_site], np.maximum(mean + deviation * draw, 0.0)[of_site])
    return worst


def hides(blockers: Blockers, position: Array, panels: Panels, time_s: Array) -> BoolArray:
    """Whether any vehicle cuts the line from each panel to the target, (S, I). Arguments as in `blockage_db`."""
    row = _column(blockers, time_s)
    hidden = np.zeros(panels.x.shape, dtype=bool)
    for vehicle in range(len(blockers.ids)):
        hidden |= _between(blockers, vehicle, row, position, panels)
    return hidden


def _column(blockers: Blockers, time_s: Array) -> IntArray:
    """Column of the blockers' arrays at each instant, (S,)."""
    return np.clip(np.round((time_s - blockers.begin_s) / blockers.step_s).astype(np.int64), 0, blockers.x.shape[1] - 1)


def mean_loss_db(distance_m: Array, low_m: Array, top_m: Array, blocker_m: Array | float) -> tuple[Array, Array]:
    """Mean and standard deviation of one vehicle's loss, one way, dB; both 0 if both ends are above the vehicle.

    distance_m: between the ends of the path, (...). low_m, top_m: heights of the lower and the higher end, m, (...).
    blocker_m: height of the vehicle, m, (...). Source: 3GPP TR 37.885, 6.2.1, NLOSv.
    """
    grows = np.maximum(0.0, 15 * np.log10(distance_m) - 41)
    buried = top_m < blocker_m
    mean = np.where(buried, 9 + grows, 5 + grows)
    clear = low_m > blocker_m
    return np.where(clear, 0.0, mean), np.where(clear, 0.0, np.where(buried, 4.5, 4.0))


def _ends(panels: Panels) -> tuple[Array, Array]:
    """Heights of the lower and the higher end of each path above the road, m."""
    target = np.full_like(panels.height_m, panels.target_height_m)
    mast = panels.height_m + panels.target_height_m
    return np.minimum(target, mast), np.maximum(target, mast)


def _between(blockers: Blockers, vehicle: int, row: IntArray, position: Array, panels: Panels) -> BoolArray:
    """Whether a vehicle's box cuts the line from each panel to the target, (S, I)."""
    front = np.stack([blockers.x[vehicle, row], blockers.y[vehicle, row]], axis=1)
    size = np.array([[of[vehicle] for of in (blockers.length_m, blockers.width_m, blockers.height_m)]])
    return cuts(front, blockers.heading[vehicle, row], size, position, panels)


def cuts(front: Array, heading: Array, size: Array, position: Array, panels: Panels) -> BoolArray:
    """Whether a vehicle's box cuts the line from each panel to a target, (S, I).

    front: of the vehicle's front bumper's centre, m, (S, 2). heading: unit vector, (S, 2). size: length, width and
    height, m, (S, 3) or (1, 3). position: of the target, m, (S, 2).
    """
    heading = heading[:, None, :]
    centre_x = front[:, :1] - heading[..., 0] * size[:, :1] / 2
    centre_y = front[:, 1:] - heading[..., 1] * size[:, :1] / 2

    def in_its_frame(x: Array, y: Array) -> tuple[Array, Array]:
        along = (x - centre_x) * heading[..., 0] + (y - centre_y) * heading[..., 1]
        across = (y - centre_y) * heading[..., 0] - (x - centre_x) * heading[..., 1]
        return along, across

    start = in_its_frame(panels.x, panels.y)
    end = in_its_frame(position[:, :1], position[:, 1:])
    shape = np.broadcast_shapes(start[0].shape, end[0].shape)
    enter, leave = np.zeros(shape), np.ones(shape)
    for first, last, half in zip(start, end, (size[:, :1] / 2, size[:, 1:2] / 2), strict=True):
        step = np.where(np.abs(last - first) < 1e-9, 1e-9, last - first)
        one, other = (-half - first) / step, (half - first) / step
        enter = np.maximum(enter, np.minimum(one, other))
        leave = np.minimum(leave, np.maximum(one, other))
    # The line falls from the mast to the target: it is lowest where it leaves the box.
    height = panels.target_height_m + panels.height_m * (1 - leave)
    rising = panels.height_m < 0
    height = np.where(rising, panels.target_height_m + panels.height_m * (1 - enter), height)
    return np.asarray((enter < leave) & (height < size[:, 2:]))
