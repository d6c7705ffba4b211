"""A vehicle's track in the plane with the corners of its road rounded.

SUMO's vehicles follow the centre lines of lanes, which are polygons. A track is taken apart into a reference line,
which follows the lanes that the vehicle drives, and the vehicle's lateral offset from it. The reference line is made
smooth (`isacsim.scenarios.reference_line`), and the track is put together again. Where the line needs no rounding, the
track stays as it is, to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isacsim.arrays import Array, ComplexArray
from isacsim.scenarios.lane import Lane
from isacsim.scenarios.reference_line import STEP_M, RoundingSettings, Smoothing, rounding_widths
from isacsim.traffic.recording import Recording, Track

CHANGE_S, CHANGE_M = 3.0, 20.0
"""The reference line moves from one lane to the next over this time, s, or this distance, m, if that is longer, before
and after the vehicle crosses the marking. Its own lateral acceleration is 0.5 m/s2 or less then."""


@dataclass(frozen=True)
class RoundedTrack:
    """Positions of a track on a rounded road, m, shape (n,) each, and how far rounding moved each of them, m."""

    x: Array
    y: Array
    shift_m: Array


def rounded_track(recording: Recording, track: Track, settings: RoundingSettings) -> RoundedTrack:
    """Return the positions of a track with the corners of its road rounded.

    The positions are not yet smoothed in time. A recording without lanes has no centre lines; its tracks are returned
    as they are.
    """
    unchanged = RoundedTrack(track.x, track.y, np.zeros(len(track)))
    if not recording.lanes or len(track) < 3:
        return unchanged
    headings = lane_headings(recording.lanes, track)
    offset = _lateral_offset(track, recording.step_s)
    position = track.x + 1j * track.y
    reference = position - 1j * headings * offset
    station = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(reference)))])
    along = _along_shift(track, recording.step_s, station, settings)
    grid = np.arange(0.0, station[-1], STEP_M)
    if len(grid) < 3:
        return unchanged
    line = Smoothing(_at(grid, station, reference))
    speeds = np.interp(grid, station, track.speed)
    widths = rounding_widths(line, speeds, settings.width_s, settings.lateral_mps2, settings.max_shift_m)
    station = station + along
    changed = (along != 0.0) | (np.interp(station, grid, widths) > 0.0)
    if not changed.any():
        return unchanged
    normals = 1j * Smoothing(_at(grid, station - along, headings)).at(widths)
    rounded = np.where(
        changed, _at(station, grid, line.at(widths)) + offset * _at(station, grid, normals / np.abs(normals)), position
    )
    return RoundedTrack(rounded.real, rounded.imag, np.abs(rounded - position))


def _along_shift(track: Track, step_s: float, station: Array, settings: RoundingSettings) -> Array:
    """Return how far each row of a track moves along its reference line so that the speed changes smoothly, m, (n,).

    All lanes of an edge have one length in SUMO, whatever that of their shapes is. In the plane, a vehicle is therefore
    faster on some lanes than on others, and its speed steps where the lane changes.
    station: distances along the reference line, m, shape (n,).
    """
    driven = np.concatenate([[0.0], np.cumsum((track.speed[1:] + track.speed[:-1]) / 2.0 * step_s)])
    grid = np.arange(0.0, driven[-1], STEP_M)
    if len(grid) < 3:
        return np.zeros(len(track))
    surplus = Smoothing(_at(grid, driven, (station - driven).astype(np.complex128)))
    speeds = np.interp(grid, driven, track.speed)
    widths = rounding_widths(surplus, speeds, settings.width_s, settings.along_mps2, settings.max_shift_m)
    return _at(driven, grid, surplus.at(widths) - surplus.values).real


def lane_headings(lanes: tuple[Lane, ...], track: Track) -> ComplexArray:
    """Return the direction of the centre line at each row of a track, as a complex unit vector, shape (n,)."""
    headings = np.full(len(track), np.nan, np.complex128)
    for k in np.unique(track.lane):
        rows = np.flatnonzero(track.lane == k)
        shape = lanes[k].shape @ np.array([1.0, 1.0j])
        steps = np.diff(shape)
        steps = steps[np.abs(steps) > 0]
        if len(steps):
            ends = np.cumsum(np.abs(steps))
            # SUMO stretches the shape of a lane to the lane's length.
            at = np.searchsorted(ends, track.lane_pos[rows] * ends[-1] / lanes[k].length_m, side="right")
            headings[rows] = (steps / np.abs(steps))[np.minimum(at, len(steps) - 1)]
    known = np.flatnonzero(~np.isnan(headings))
    if not len(known):
        return np.ones(len(track), np.complex128)
    # A lane without extent has no direction: that of the row before holds on.
    return headings[known[np.maximum(np.searchsorted(known, np.arange(len(track)), side="right") - 1, 0)]]


def _lateral_offset(track: Track, step_s: float) -> Array:
    """Return the offset of a vehicle from its reference line, m, left positive, shape (n,).

    It is continuous where the lane changes. From the centre line of one lane, the reference line moves on to that of
    the next around the row where the vehicle crosses the marking, so that the offset stays within about a lane's width.
    """
    offset = np.array(track.lane_lat)
    driven = np.cumsum(track.speed) * step_s
    for row in np.flatnonzero(track.lane[1:] != track.lane[:-1]) + 1:
        step = track.lane_lat[row] - track.lane_lat[row - 1]
        reach = max(CHANGE_M, CHANGE_S * float(track.speed[row]))
        first, end = np.searchsorted(driven, driven[row] + np.array([-reach, reach]))
        u = (driven[first:end] - driven[row]) / (2.0 * reach) + 0.5
        blend = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        offset[first:row] += step * blend[: row - first]
        offset[row:end] -= step * (1.0 - blend[row - first :])
    return offset


def _at(points: Array, knots: Array, values: ComplexArray) -> ComplexArray:
    return np.asarray(np.interp(points, knots, values))
