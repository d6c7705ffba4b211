"""The lanes of a road network as a search tree: where in its lane a vehicle is, from position and velocity alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SPACING_M = 2.0
"""Spacing of the points that represent a centre line; on a curve of 100 m radius they are up to 5 mm off it."""
CANDIDATES = 24
"""How many nearest points are searched for one whose lane leads the vehicle's way; points of crossing and oncoming
lanes are passed over."""
SAME_WAY_COS = 0.5
"""A lane leads a vehicle's way if its direction is within 60 degrees of the vehicle's motion."""


class CentreLine(Protocol):
    """A lane: its centre line (n, 2), m, in the scenario's plane and in the direction of driving, its width and its id.

    The id is SUMO's: the edge, an underscore, and the number of the lane, counted from the outermost one.
    """

    @property
    def id(self) -> str: ...
    @property
    def shape(self) -> npt.NDArray[np.floating]: ...
    @property
    def width_m(self) -> float: ...


@dataclass(frozen=True)
class InLane:
    """The places of n vehicles in their lanes.

    offset_m: distance from the centre line, positive to the left, (n,). width_m: of the lane, (n,). heading: direction
    of the lane there, unit vectors (n, 2).
    """

    offset_m: Array
    width_m: Array
    heading: Array


@dataclass(frozen=True)
class LaneMap:
    """Points along all centre lines.

    tree: of the m points. heading: direction of the lane at each point, unit vectors (m, 2). bend: its curvature,
    positive to the left, 1/m, (m,). width_m: its width, (m,). lefthand: whether traffic keeps left.
    """

    tree: cKDTree
    heading: Array
    bend: Array
    width_m: Array
    lefthand: bool = False

    @classmethod
    def of(cls, lanes: Sequence[CentreLine], corner_m: float = 10.0) -> Self:
        """Make the map of the lanes of a network; at least one must have a length above 0.

        corner_m: how far before and behind a vertex of a coarsely drawn lane its direction changes, m. Vehicles that
        keep their lane on such roads seem to move least to the side with 10 m: the recordings round corners so.
        """
        from scipy.spatial import cKDTree  # loaded only here, because it takes long

        parts = [_points(np.asarray(lane.shape, dtype=np.float64), corner_m) for lane in lanes]
        points, heading, bend = (np.concatenate(side) for side in zip(*parts, strict=True))
        width = np.repeat([float(lane.width_m) for lane in lanes], [len(part[0]) for part in parts])
        return cls(cKDTree(points), heading, bend, width, keeps_left(lanes))

    def place(self, position: Array, velocity: Array, standing_mps: float = 0.5) -> InLane:
        """Return the places of vehicles at positions (n, 2), m, with velocities (n, 2), m/s.

        A vehicle is in the nearest lane that leads within a quarter of 60 degrees of its way, else in the nearest
        within 60 degrees, else in the nearest of all. So is one that stands: below standing_mps, a sensed velocity
        points where its error does.
        """
        count = min(CANDIDATES, self.tree.n)
        near = np.asarray(self.tree.query(position, k=np.arange(1, count + 1))[1])
        speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-9)
        along = np.einsum("nkc,nc->nk", self.heading[near], velocity) / speed[:, None]
        # On junctions, lanes that turn lie over those that go on.
        fits = (along > SAME_WAY_COS).astype(np.int8) + (along > np.cos(np.arccos(SAME_WAY_COS) / 4))
        fits[speed < standing_mps] = 0
        nearest = near[np.arange(len(near)), fits.argmax(axis=1)]
        heading, bend, away = self.heading[nearest], self.bend[nearest], position - self.tree.data[nearest]
        past = np.einsum("nk,nk->n", heading, away)
        turned = np.stack([heading[:, 0] - bend * past * heading[:, 1], heading[:, 1] + bend * past * heading[:, 0]], 1)
        turned /= np.hypot(turned[:, 0], turned[:, 1])[:, None]
        return InLane(_cross(heading, away) - bend * past**2 / 2, self.width_m[nearest], turned)


def keeps_left(lanes: Sequence[CentreLine]) -> bool:
    """Return whether traffic keeps left: the lanes of most edges are then numbered from left to right."""
    by_id = {lane.id: np.asarray(lane.shape, dtype=np.float64) for lane in lanes}
    lefts = rights = 0
    for name, line in by_id.items():
        edge, _, number = name.rpartition("_")
        inner = by_id.get(f"{edge}_{int(number) + 1}") if number.isdecimal() else None
        if inner is None:
            continue
        along, across = line[-1] - line[0], inner.mean(axis=0) - line.mean(axis=0)
        side = along[0] * across[1] - along[1] * across[0]
        lefts, rights = lefts + (side > 0), rights + (side < 0)
    return rights > lefts


def _points(line: Array, corner_m: float) -> tuple[Array, Array, Array]:
    """Return points of a polyline (n, 2) at most SPACING_M apart, with direction and bend; none if it has no length."""
    parts = np.diff(line, axis=0)
    length = np.hypot(parts[:, 0], parts[:, 1])
    line, parts, length = np.concatenate([line[:1], line[1:][length > 0]]), parts[length > 0], length[length > 0]
    if not len(length):
        return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    reached = np.concatenate([[0.0], np.cumsum(length)])
    at = np.linspace(0, reached[-1], max(2, int(np.ceil(reached[-1] / SPACING_M)) + 1))
    # The direction changes evenly between the middles of the segments, instead of jumping at the vertices. Where a road
    # is drawn coarsely, a segment is no chord of a long bend: vehicles follow it, and round its ends in some metres.
    angle = np.unwrap(np.arctan2(parts[:, 1], parts[:, 0]))
    middle, half = (reached[1:] + reached[:-1]) / 2, np.maximum(length / 2 - corner_m, 0.0)
    turned = np.interp(at, np.stack([middle - half, middle + half], axis=1).ravel(), np.repeat(angle, 2))
    points = np.stack([np.interp(at, reached, line[:, k]) for k in (0, 1)], axis=1)
    return points, np.stack([np.cos(turned), np.sin(turned)], axis=1), np.gradient(turned, at)


def _cross(a: Array, b: Array) -> Array:
    """Return the z component of the cross product of vectors (n, 2): how far b points to the left of a."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
