"""From the coordinates of a file to the plane of a road network: which of several shifts puts positions on it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.xml_files import elements

BESIDE_M = 500.0
"""Vehicles may be so far outside the bounds of their network, m."""
SAMPLED = 10_000
"""So many positions show which shift is right."""


def in_plane(
    x: Array, y: Array, road: Scenario, shifts: Sequence[tuple[float, float]]
) -> tuple[Array, Array] | None:  # fmt: skip
    """Return positions in the scenario's plane, m: with the first shift that puts most of them on its network, if any.

    shifts: from the coordinates of the file to SUMO's, m.
    """
    points = np.concatenate([lane.shape for lane in road.lanes])
    low, high = points.min(axis=0) - BESIDE_M, points.max(axis=0) + BESIDE_M

    def inside(east: Array, north: Array) -> BoolArray:
        return np.asarray((east >= low[0]) & (east <= high[0]) & (north >= low[1]) & (north <= high[1]))

    sampled = slice(None, None, max(1, len(x) // SAMPLED))
    for shift in shifts:
        east, north = x + (shift[0] - road.origin[0]), y + (shift[1] - road.origin[1])
        if inside(east[sampled], north[sampled]).mean() >= 0.5:
            return east, north
    return None


def net_offset(network: Path) -> tuple[float, float]:
    """Return what netconvert added to the projected coordinates of a network, m."""
    for element in elements(network):
        if element.name == "location":
            try:
                east, north = (float(part) for part in element.attributes["netOffset"].split(","))
            except (KeyError, ValueError):
                break
            return east, north
    return 0.0, 0.0
