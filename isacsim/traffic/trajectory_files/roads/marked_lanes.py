"""Lanes between straight markings, as a camera above a road sees them, for the two directions of the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.checks import OFF_ROAD_M
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array


@dataclass(frozen=True)
class MarkedCarriageway:
    """Parallel lanes of one direction, along the x axis.

    name: of its edge. markings: y of the markings in the plane, m, ascending, shape (k + 1,) for k lanes. forward:
    whether it is driven towards larger x. start_m, end_m: the x at which its lanes start and end, m, start below end.
    """

    name: str
    markings: Array
    forward: bool
    start_m: float
    end_m: float

    @property
    def lanes(self) -> list[Lane]:
        """Its lanes, from the rightmost one as its drivers see it."""
        ends = (self.start_m, self.end_m) if self.forward else (self.end_m, self.start_m)
        borders = self.markings if self.forward else self.markings[::-1]
        return [
            Lane(
                f"{self.name}_{k}", self.name, k, abs(float(borders[k + 1] - borders[k])), self.end_m - self.start_m,
                np.array([[x, (borders[k] + borders[k + 1]) / 2.0] for x in ends]), (),
            )
            for k in range(len(borders) - 1)
        ]  # fmt: skip

    def lane_of(self, y: Array) -> Int32Array:
        """Return the index of the lane at each y, m, shape (n,): -1 where it is more than a metre off the road."""
        count = len(self.markings) - 1
        upward = np.clip(np.searchsorted(self.markings, y, side="right") - 1, 0, count - 1)
        index = upward if self.forward else count - 1 - upward
        on_road = (y >= self.markings[0] - OFF_ROAD_M) & (y <= self.markings[-1] + OFF_ROAD_M)
        return np.where(on_road, index, -1).astype(np.int32)


def lanes_and_numbers(
    carriageways: Sequence[MarkedCarriageway], y: Array, on: Sequence[BoolArray]
) -> tuple[tuple[Lane, ...], Int32Array]:
    """Return the lanes of all carriageways, and for each y, m, shape (n,), the number of its lane among them, or -1.

    on: for each carriageway, which positions are on it, shape (n,).
    """
    lanes: list[Lane] = []
    number = np.full(len(y), -1, np.int32)
    for carriageway, here in zip(carriageways, on, strict=True):
        index = carriageway.lane_of(y[here])
        number[here] = np.where(index >= 0, index + len(lanes), -1)
        lanes += carriageway.lanes
    return tuple(lanes), number
