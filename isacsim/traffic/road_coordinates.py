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

from isac_cosim.base.arrays import Array, BoolArray, ComplexArray, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.reference_line import STEP_M, RoundingSettings, stretches
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

CHANGE_S, CHANGE_M = 3.0, 20.0
"""The reference line moves from one lane to the next over this time, s, or this distance, m, if that is longer, before
and after the vehicle crosses the marking. Its own lateral acceleration is 0.5 m/s2 or less then."""
SLOWEST_MPS = 3.5
"""Roads are rounded for vehicles of at least this speed, m/s: slower ones do not turn more sharply."""
SHARPEST = 0.1
"""A road turns back at once where the sum of two unit vectors along it is shorter than this."""


@dataclass(frozen=True)
class MovedRows:
    """The rows of a track that rounding moves, shape (k,), and what they are on the rounded road, shape (k,) each.

    position: x + iy, m. heading: direction of the road, complex unit vectors.
    """

    rows: IntArray
    position: ComplexArray
    heading: ComplexArray


UNMOVED = MovedRows(np.empty(0, np.int64), np.empty(0, np.complex128), np.empty(0, np.complex128))


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


class RoundedLine:
    """The line along the road that a vehicle drives, with the corners rounded that are too sharp for its speed.

    Where nothing is rounded, it is what the rows of the track say.
    """

    def __init__(
        self, station: Array, line: ComplexArray, headings: ComplexArray, speed: Array, settings: RoundingSettings
    ) -> None:
        """station: how far along the road each row of a track is, m, shape (n,). line: where the line is there, x + iy,
        m. headings: its direction, complex unit vectors. speed: of the vehicle, m/s. All of shape (n,).
        """
        ahead = _ahead(station)
        self._knots, self._line, self._headings = station[ahead], line[ahead], headings[ahead]
        self._grid = np.arange(0.0, self._knots[-1], STEP_M)
        self._widths = np.zeros(len(self._grid))
        self._smooth = self._tangents = np.zeros(len(self._grid), np.complex128)
        if len(self._grid) < 3:
            return
        smooth = _at(self._grid, self._knots, self._line)
        speeds = np.maximum(np.interp(self._grid, self._knots, speed[ahead]), SLOWEST_MPS)
        bends = stretches(smooth, speeds, settings.width_s, settings.lateral_mps2, settings.max_shift_m)
        tangents = _at(self._grid, self._knots, self._headings) if bends else smooth
        for bend in bends:
            self._widths[bend.span] = bend.widths
            smooth[bend.span] = bend.line.at(bend.widths)
            tangents[bend.span] = bend.smoothed(tangents)
        self._smooth, self._tangents = smooth, tangents

    def is_rounded(self, station: Array) -> BoolArray:
        """Return at which stations, m, (k,), the line differs from what the rows of the track say, (k,)."""
        if not self._widths.any():
            return np.zeros(len(station), bool)
        # The grid ends up to a step before the track does.
        return np.asarray((np.interp(station, self._grid, self._widths) > 0.0) & (station <= self._grid[-1]))

    def places(self, station: Array, offset: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return positions x + iy, m, and the directions of the line there, complex unit vectors, both of shape (k,).

        station: along the line, m, shape (k,). offset: from the line, left positive, m, shape (k,).
        """
        centre = _at(station, self._knots, self._line)
        heading = self._headings[np.searchsorted(self._knots[1:], station, side="right")]
        rounded = self.is_rounded(station)
        if rounded.any():
            centre[rounded] = _at(station[rounded], self._grid, self._smooth)
            tangents = _at(station[rounded], self._grid, self._tangents)
            heading[rounded] = tangents / np.abs(tangents)
        return centre + 1j * heading * offset, heading


def moved_rows(recording: Recording, track: Track, settings: RoundingSettings) -> MovedRows:
    """Return the rows of a track that move when the corners of its road are rounded.

    The positions are not yet smoothed in time. A recording without lanes has no centre lines; its tracks do not move.
    """
    if not recording.lanes or len(track) < 3:
        return UNMOVED
    place, headings = track.x + 1j * track.y, lane_headings(recording.lanes, track.lane, track.lane_pos)
    offset = _lateral_offset(track, recording.step_s)
    reference = place - 1j * headings * offset
    station = _progress(reference, headings)
    line = RoundedLine(station, reference, headings, track.speed, settings)
    rounded = line.is_rounded(station)
    if rounded.any():
        place[rounded], headings[rounded] = line.places(station[rounded], offset[rounded])
    progress = _progress(place, headings)
    wanted = _even_progress(progress, track, recording.step_s, settings)
    shifted = wanted != progress
    if shifted.any():
        knots = _ahead(progress, station)
        station[shifted] = np.interp(wanted[shifted], progress[knots], station[knots])
    rows = np.flatnonzero(rounded | shifted)
    return MovedRows(rows, *line.places(station[rows], offset[rows])) if len(rows) else UNMOVED


def _progress(position: ComplexArray, headings: ComplexArray) -> Array:
    """Return how far positions have come along their road, m, shape (n,).

    headings: direction of the road at each position, complex unit vectors. Where SUMO moves a vehicle back along the
    road, as it may where the lane changes, so does the progress.
    """
    steps, mean = np.diff(position), headings[1:] + headings[:-1]
    turn = np.abs(mean)
    along = np.real(np.conj(mean) * steps) / np.maximum(turn, 1.0)
    # Where the road turns back at once, the two directions have no mean.
    return np.concatenate([[0.0], np.cumsum(np.where(turn < SHARPEST, np.abs(steps), along))])


def _ahead(*progress: Array) -> IntArray:
    """Return the rows at which a vehicle is further ahead than ever before, in several measures, shape (k,)."""
    rows = np.arange(len(progress[0]))
    for values in progress:
        furthest = np.maximum.accumulate(values[rows])
        rows = rows[np.concatenate([[True], values[rows][1:] > furthest[:-1]])]
    return rows


def _even_progress(progress: Array, track: Track, step_s: float, settings: RoundingSettings) -> Array:
    """Return the progress along the road with which the speed is SUMO's, or changes smoothly where it cannot be, (n,).

    All lanes of an edge have one length in SUMO, whatever that of their shapes is. In the plane, a vehicle is therefore
    faster on some lanes than on others, its speed steps where the lane ends, and a change of lane moves it along the
    road. A rounded corner is shorter than the one on which SUMO measures.
    progress: that of the positions in the plane, m, shape (n,). It stays as it is where the speed in the plane differs
    little from SUMO's.
    """
    driven = np.concatenate([[0.0], np.cumsum((track.speed[1:] + track.speed[:-1]) / 2.0 * step_s)])
    grid = np.arange(0.0, driven[-1], STEP_M)
    if len(grid) < 3:
        return progress
    surplus = np.interp(grid, driven, progress - driven).astype(np.complex128)
    speeds = np.maximum(np.interp(grid, driven, track.speed), SLOWEST_MPS)
    wanted = progress.copy()
    for stretch in stretches(surplus, speeds, settings.width_s, settings.along_mps2, settings.max_shift_m):
        widened = np.zeros(len(grid))
        widened[stretch.span] = stretch.widths
        smooth = surplus.real.copy()
        smooth[stretch.span] = stretch.line.at(stretch.widths).real
        rows = (np.interp(driven, grid, widened) > 0.0) & (driven <= grid[-1])
        wanted[rows] = driven[rows] + np.interp(driven[rows], grid, smooth)
    return wanted


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
