"""Where a vehicle is in its lane, from its position and motion alone: the lanes of a road network, searchable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from isacsim.arrays import Array

SPACING_M = 2.0
"""Of the points that stand for a centre line; on a curve of 100 m radius it departs from them by 5 mm."""
CANDIDATES = 24
"""Nearest points looked at for one that leads the vehicle's way: those of crossing lanes and of the other direction
are passed over."""
SAME_WAY_COS = 0.5
"""A lane within 60 degrees of the vehicle's motion leads its way."""


class CentreLine(Protocol):
    """A lane: its centre line (n, 2), m, in the scenario's plane, in the direction of driving, and its width."""

    @property
    def shape(self) -> npt.NDArray[np.floating]: ...
    @property
    def width_m(self) -> float: ...


@dataclass(frozen=True)
class InLane:
    """Places in lanes. offset_m: left of the centre line, (n,). width_m: of the lane, (n,). heading: its direction
    there, a unit vector, (n, 2).
    """

    offset_m: Array
    width_m: Array
    heading: Array


@dataclass(frozen=True)
class LaneMap:
    """Points along all centre lines, (m, 2), with what their lane is there: its direction, a unit vector (m, 2), its
    bend to the left, 1/m, and its width, (m,).
    """

    tree: cKDTree
    heading: Array
    bend: Array
    width_m: Array

    @classmethod
    def of(cls, lanes: Sequence[CentreLine]) -> Self:
        """The map of a network's lanes, at least one of them longer than nothing."""
        parts = [_points(np.asarray(lane.shape, dtype=np.float64)) for lane in lanes]
        points, heading, bend = (np.concatenate(side) for side in zip(*parts, strict=True))
        width = np.repeat([float(lane.width_m) for lane in lanes], [len(part[0]) for part in parts])
        return cls(cKDTree(points), heading, bend, width)

    def place(self, position: Array, velocity: Array) -> InLane:
        """Places of vehicles at positions (n, 2), m, that move with velocities (n, 2), m/s.

        The nearest lane that leads a vehicle's way is its own; where none is near, the nearest lane of all.
        """
        count = min(CANDIDATES, self.tree.n)
        near = np.asarray(self.tree.query(position, k=np.arange(1, count + 1))[1])
        speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-9)
        leads = np.einsum("nkc,nc->nk", self.heading[near], velocity) > SAME_WAY_COS * speed[:, None]
        own = near[np.arange(len(near)), leads.argmax(axis=1)]
        heading, bend, away = self.heading[own], self.bend[own], position - self.tree.data[own]
        past = np.einsum("nk,nk->n", heading, away)
        turned = np.stack([heading[:, 0] - bend * past * heading[:, 1], heading[:, 1] + bend * past * heading[:, 0]], 1)
        turned /= np.hypot(turned[:, 0], turned[:, 1])[:, None]
        return InLane(_cross(heading, away) - bend * past**2 / 2, self.width_m[own], turned)


def _points(line: Array) -> tuple[Array, Array, Array]:
    """Points of a polyline (n, 2) at most SPACING_M apart, direction and bend at each; none where it has no length."""
    parts = np.diff(line, axis=0)
    length = np.hypot(parts[:, 0], parts[:, 1])
    line, parts, length = np.concatenate([line[:1], line[1:][length > 0]]), parts[length > 0], length[length > 0]
    if not len(length):
        return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
    reached = np.concatenate([[0.0], np.cumsum(length)])
    at = np.linspace(0, reached[-1], max(2, int(np.ceil(reached[-1] / SPACING_M)) + 1))
    # Direction changes evenly between the middles of the parts, not in leaps at the vertices.
    angle = np.unwrap(np.arctan2(parts[:, 1], parts[:, 0]))
    turned = np.interp(at, (reached[1:] + reached[:-1]) / 2, angle)
    points = np.stack([np.interp(at, reached, line[:, k]) for k in (0, 1)], axis=1)
    return points, np.stack([np.cos(turned), np.sin(turned)], axis=1), np.gradient(turned, at)


def _cross(a: Array, b: Array) -> Array:
    """z of the cross product of vectors (n, 2): how far b points to the left of a."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
