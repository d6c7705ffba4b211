"""Tracks in lanes, made of the states of a file: split where a vehicle is not seen, sampled evenly, placed in lanes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.isacsim.traffic.trajectory_files.blocks import Block
from isac_cosim.isacsim.traffic.trajectory_files.conditioning import Sampling
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces, runs
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates, FileVehicle

LONGEST_GAP_S = 0.3
"""A vehicle that is not seen for longer has two tracks, s."""
JUMP_MPS = 2.5
"""Vehicles do not move faster across their lane than this, m/s."""
JUMP_M = 0.5
"""Smaller steps across the lane are no jumps, m."""
LEAST_STATES = 3
"""Fewer states are no track."""


@dataclass(frozen=True)
class TrackPiece:
    """A vehicle as long as it is seen. name: its id, with `#2`, `#3`, ... from its second piece on. Arrays (n,)."""

    name: str
    vehicle: FileVehicle
    step: IntArray
    x: Array
    y: Array
    lane: IntArray


def pieces(
    observed: FileStates, number: int, places: LanePlaces, jumps: IntArray
) -> tuple[list[TrackPiece], int, int]:  # fmt: skip
    """Return the pieces of a vehicle; how often it changes lanes on one edge, and how often of these in a jump.

    A piece ends where the vehicle is not seen for longer than `LONGEST_GAP_S`, where no lane is known, where it jumps
    from lane to lane in one step, as in simulations in which lane changes take no time, and where its position jumps.
    jumps: the rows after which positions jump, ascending.
    """
    span = slice(int(observed.starts[number]), int(observed.starts[number + 1]))
    rows = np.flatnonzero(observed.lane[span] >= 0) + span.start
    step, x, y = observed.step[rows], observed.x[rows], observed.y[rows]
    lane = observed.lane[rows].astype(np.int64)
    cut = np.diff(step) * observed.period_s > LONGEST_GAP_S + 1e-9
    if observed.period_s >= LONGEST_GAP_S:
        cut = np.diff(step) > 1
    changes = at_once = 0
    for row in np.flatnonzero((lane[1:] != lane[:-1]) & ~cut).tolist():
        if places.beside(int(lane[row]), int(lane[row + 1])):
            pair = places.places(int(lane[row]), x[row : row + 2] + 1j * y[row : row + 2])
            across = abs(float(pair.left[1] - pair.left[0]))
            within_s = float(step[row + 1] - step[row]) * observed.period_s
            changes += 1
            if across > max(JUMP_M, JUMP_MPS * within_s):
                cut[row] = True
                at_once += 1
    cut |= np.diff(np.searchsorted(jumps, rows)) > 0
    vehicle = observed.vehicles[number]
    edges = [0, *(np.flatnonzero(cut) + 1).tolist(), len(step)]
    found: list[TrackPiece] = []
    for first, after in pairwise(edges):
        if after - first >= LEAST_STATES:
            name = vehicle.id if not found else f"{vehicle.id}#{len(found) + 1}"
            part = slice(first, after)
            found.append(TrackPiece(name, vehicle, step[part], x[part], y[part], lane[part]))
    return found, changes, at_once


def tracks(
    pieces: list[TrackPiece], block: Block, sampling: Sampling, places: LanePlaces, bystander: bool
) -> Iterator[Track]:
    """Yield the tracks of a vehicle's pieces within a block. bystander: see `Track`."""
    for piece in pieces:
        if piece.step[-1] < block.first or piece.step[0] > block.last:
            continue
        x, vx = sampling.motion(piece.step, piece.x)
        y, vy = sampling.motion(piece.step, piece.y)
        per_step, first = sampling.per_step, int(piece.step[0])
        kept = slice(max(0, (block.first - first) * per_step), max(0, min(len(x), (block.last - first) * per_step + 1)))
        if kept.stop - kept.start < LEAST_STATES:
            continue
        track = _track(piece, first * per_step + kept.start, x[kept] + 1j * y[kept], vx[kept] + 1j * vy[kept],
                       *_lanes(piece, kept, per_step), places, bystander)  # fmt: skip
        yield track


def _lanes(piece: TrackPiece, kept: slice, per_step: int) -> tuple[IntArray, IntArray]:
    """Return the lane of the states before and after each sample, (m,) each."""
    at = np.arange(kept.start, kept.stop) / per_step + piece.step[0]
    before = np.searchsorted(piece.step, at + 1e-9, side="right") - 1
    after = np.searchsorted(piece.step, at - 1e-9, side="left")
    return piece.lane[before], piece.lane[np.minimum(after, len(piece.lane) - 1)]


def _track(
    piece: TrackPiece,
    first_step: int,
    position: ComplexArray,
    velocity: ComplexArray,
    before: IntArray,
    after: IntArray,
    places: LanePlaces,
    bystander: bool,
) -> Track:
    lane = before.copy()
    along, left, heading = np.empty(len(lane)), np.empty(len(lane)), np.empty(len(lane), np.complex128)
    for start, stop in runs(before * (len(places.lanes) + 1) + after):
        a, b, part = int(before[start]), int(after[start]), slice(start, stop)
        found = places.places(a, position[part])
        values = (found.along, found.left, found.heading)
        if a != b:
            # Between two states in different lanes: in the second one as soon as it is nearer, or the first one ends.
            other = places.places(b, position[part])
            second = np.abs(other.left) < np.abs(found.left) if places.beside(a, b) else found.beyond > 0
            lane[part] = np.where(second, b, a)
            values = tuple(
                np.where(second, two, one)
                for one, two in zip(values, (other.along, other.left, other.heading), strict=True)
            )  # type: ignore[assignment]
        along[part], left[part], heading[part] = values
    return Track(
        vehicle=piece.name,
        kind=piece.vehicle.kind,
        length_m=piece.vehicle.length_m,
        width_m=piece.vehicle.width_m,
        first_step=first_step,
        x=np.ascontiguousarray(position.real),
        y=np.ascontiguousarray(position.imag),
        speed=np.asarray((np.conj(heading) * velocity).real),
        lane=lane.astype(np.int32),
        lane_pos=along,
        lane_lat=left,
        bystander=bystander,
    )
