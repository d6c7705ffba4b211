"""A vehicle's track in the plane with the corners of its road rounded.

SUMO's vehicles follow the centre lines of lanes, which are polygons. A track is taken apart into a reference line,
which follows the lanes that the vehicle drives, and the vehicle's lateral offset from it. The reference line is made
smooth (`isacsim.scenarios.reference_line`), and the track is put together again. Where the line needs no rounding, the
track stays as it is, to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.reference_line import STEP_M, RoundingSettings, stretches
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

CHANGE_S, CHANGE_M = 3.0, 20.0
"""The reference line moves from one lane to the next over this time, s, or this distance, m, if that is longer, before
and after the vehicle crosses the marking. Its own lateral acceleration is 0.5 m/s2 or less then."""


@dataclass(frozen=True)
class MovedRows:
    """The rows of a track that rounding moves, shape (k,), and their positions x + iy on the rounded road, m, (k,)."""

    rows: IntArray
    position: ComplexArray


UNMOVED = MovedRows(np.empty(0, np.int64), np.empty(0, np.complex128))


@dataclass(frozen=True)
class RoundedTrack:
    """Positions of a track on a rounded road, m, shape (n,) each, and how far rounding moved each of them, m."""

    x: Array
    y: Array
    shift_m: Array

    @classmethod
    def of(cls, track: Track, moved: MovedRows) -> Self:
        """Return a track with some of its rows moved."""
        if not len(moved.rows):
            return cls(track.x, track.y, np.zeros(len(track)))
        x, y, shift_m = track.x.copy(), track.y.copy(), np.zeros(len(track))
        x[moved.rows], y[moved.rows] = moved.position.real, moved.position.imag
        shift_m[moved.rows] = np.abs(moved.position - (track.x[moved.rows] + 1j * track.y[moved.rows]))
        return cls(x, y, shift_m)


def moved_rows(recording: Recording, track: Track, settings: RoundingSettings) -> MovedRows:
    """Return the rows of a track that move when the corners of its road are rounded.

    The positions are not yet smoothed in time. A recording without lanes has no centre lines; its tracks do not move.
    """
    if not recording.lanes or len(track) < 3:
        return UNMOVED
    headings = lane_headings(recording.lanes, track.lane, track.lane_pos)
    offset = _lateral_offset(track, recording.step_s)
    position = track.x + 1j * track.y
    reference = position - 1j * headings * offset
    station = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(reference)))])
    along = _along_shift(track, recording.step_s, station, settings)
    grid = np.arange(0.0, station[-1], STEP_M)
    if len(grid) < 3:
        return UNMOVED
    line, speeds = _at(grid, station, reference), np.interp(grid, station, track.speed)
    bends = stretches(line, speeds, settings.width_s, settings.lateral_mps2, settings.max_shift_m)
    if not bends and not along.any():
        return UNMOVED
    tangents, shifted = _at(grid, station, headings), station + along
    moves = along != 0.0
    if bends:
        widths = np.zeros(len(grid))
        for bend in bends:
            widths[bend.span] = bend.widths
            line[bend.span] = bend.line.at(bend.widths)
            tangents[bend.span] = bend.smoothed(tangents)
        moves |= np.interp(shifted, grid, widths) > 0.0
    # The grid ends up to a step before the track does.
    rows = np.flatnonzero(moves & (shifted <= grid[-1]))
    across = 1j * _at(shifted[rows], grid, tangents / np.abs(tangents))
    return MovedRows(rows, _at(shifted[rows], grid, line) + offset[rows] * across)


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
    surplus = np.interp(grid, driven, station - driven).astype(np.complex128)
    speeds = np.interp(grid, driven, track.speed)
    shift = np.zeros(len(grid))
    for stretch in stretches(surplus, speeds, settings.width_s, settings.along_mps2, settings.max_shift_m):
        shift[stretch.span] = (stretch.line.at(stretch.widths) - stretch.line.values).real
    return np.interp(driven, grid, shift) if shift.any() else np.zeros(len(track))


def lane_headings(lanes: Sequence[Lane], lane: npt.NDArray[np.integer[Any]], lane_pos: Array) -> ComplexArray:
    """Return the direction of the centre line at places in lanes, as complex unit vectors, shape (n,).

    lane: index of the lane of each place, shape (n,). lane_pos: position along that lane, m, shape (n,).
    A lane without extent has no direction; there, the direction of the place before holds on.
    """
    headings = np.empty(len(lane), np.complex128)
    starts = np.concatenate([[0], np.flatnonzero(lane[1:] != lane[:-1]) + 1, [len(lane)]])
    before: complex | None = None
    for start, stop in pairwise(starts.tolist()):
        ends, directions = lanes[lane[start]].segments
        if len(ends):
            segment = np.searchsorted(ends[:-1], lane_pos[start:stop], side="right")
            headings[start:stop] = directions[segment]
            if before is None:
                headings[:start] = headings[start]
            before = complex(headings[stop - 1])
        else:
            headings[start:stop] = 1.0 if before is None else before
    return headings


def smooth_step(share: Array) -> Array:
    """Return the course of a motion of least jerk from 0 to 1, at shares of its duration from 0 to 1, (n,).

    Velocity and acceleration vanish at both ends. Source: Flash and Hogan, The Journal of Neuroscience 5 (1985).
    """
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


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
        blend = smooth_step((driven[first:end] - driven[row]) / (2.0 * reach) + 0.5)
        offset[first:row] += step * blend[: row - first]
        offset[row:end] -= step * (1.0 - blend[row - first :])
    return offset


def _at(points: Array, knots: Array, values: ComplexArray) -> ComplexArray:
    return np.asarray(np.interp(points, knots, values))
