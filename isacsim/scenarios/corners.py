"""Corners of a road network that no car can take at the speed limit, and that have to be rounded noticeably."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.reference_line import (
    STEP_M,
    RoundingSettings,
    Smoothing,
    acceleration,
    rounding_widths,
)
from isac_cosim.isacsim.scenarios.xml_files import elements

CORNER_SHIFT_M = 0.5
"""Corners that are rounded by more than this are reported by default, m."""
BEYOND_M = 100.0
"""How far a lane is followed beyond its end, m."""

EASE_MPS2 = 3.0
"""How hard vehicles brake and accelerate where the speed limit changes, m/s2."""
JUNCTION = ":"
"""The beginning of the ids of edges inside junctions."""
TURNAROUND = -0.9
"""The cosine of the angle between two lanes of which one leads back from the other."""


@dataclass(frozen=True)
class SharpCorners:
    """The edges with corners that are rounded by more than `threshold_m`, and the worst of these corners.

    edges: their number, of the `of` edges that were looked at; a corner inside a junction counts for the edge that
    leads into it. worst_edge: where the corner is. speed_mps: of a vehicle there. shift_m: how far rounding moves the
    corner. acceleration_mps2: what the rounded corner takes at that speed.
    """

    threshold_m: float
    edges: int
    of: int
    worst_edge: str
    speed_mps: float
    shift_m: float
    acceleration_mps2: float

    def __str__(self) -> str:
        return (
            f"{self.edges} of {self.of} edges bend too sharply for their speed limit; their corners are rounded by "
            f"more than {self.threshold_m:g} m. The worst is edge {self.worst_edge}: rounded by {self.shift_m:.1f} m, "
            f"it still takes {self.acceleration_mps2:.0f} m/s2 at {self.speed_mps:.1f} m/s. Smooth the road or lower "
            "the limit"
        )


def speed_limits(network: Path) -> dict[str, float]:
    """Return the speed limit of each lane of a network, m/s, by the lane's id."""
    return {lane.attributes["id"]: float(lane.attributes["speed"]) for lane in elements(network) if lane.name == "lane"}


def sharp_corners(
    lanes: Sequence[Lane],
    edges: Collection[str],
    limits: Mapping[str, float],
    settings: RoundingSettings,
    threshold_m: float = CORNER_SHIFT_M,
) -> SharpCorners | None:
    """Return the corners that a vehicle on these edges cannot take at the speed limit; None where there are none.

    limits: of each lane, m/s, by its id. threshold_m: only corners that are rounded by more than this count, m. The
    worst is the one that takes the most acceleration after rounding.
    """
    by_id = {lane.id: lane for lane in lanes}
    sharp: set[str] = set()
    worst: SharpCorners | None = None
    for path in _paths([lane for lane in lanes if lane.edge in edges], by_id):
        points, owner = _points(path)
        if len(points) < 3:
            continue
        line = Smoothing(points)
        speeds = _driven(np.array([limits[lane.id] for lane in path])[owner])
        widths = rounding_widths(line, speeds, settings.width_s, settings.lateral_mps2, settings.max_shift_m)
        shift = np.abs(line.at(widths) - points)
        leading = [_leading(path, k) for k in range(len(path))]
        counted = np.array([edge in edges for edge in leading])[owner]
        beyond = np.flatnonzero((shift > threshold_m) & counted)
        if not len(beyond):
            continue
        sharp |= {leading[k] for k in np.unique(owner[beyond])}
        left = acceleration(line, widths, speeds, settings.width_s)
        k = int(beyond[np.argmax(left[beyond])])
        if worst is None or left[k] > worst.acceleration_mps2:
            edge = path[int(owner[k])].edge
            worst = SharpCorners(threshold_m, 0, len(edges), edge, float(speeds[k]), float(shift[k]), float(left[k]))
    return worst and replace(worst, edges=len(sharp))


def _leading(path: Sequence[Lane], k: int) -> str:
    """Return the edge of a path's k-th lane, of a lane inside a junction the one that leads into it."""
    return next(lane.edge for lane in reversed(path[: k + 1]) if not lane.edge.startswith(JUNCTION) or lane is path[0])


def _paths(lanes: Sequence[Lane], by_id: Mapping[str, Lane]) -> Iterator[list[Lane]]:
    """Yield each lane with the lanes that continue it, one path for each lane that does, without turnarounds."""
    for lane in lanes:
        for successor in lane.successors or ("",):
            path, length = [lane], 0.0
            while successor in by_id and length < BEYOND_M:
                path.append(by_id[successor])
                length += path[-1].length_m
                successor = next(iter(path[-1].successors), "")
            turns = [_direction(path[0], -1) * np.conj(_direction(lane, 0)) for lane in path[1:]]
            if not any(np.real(turn) < TURNAROUND for turn in turns):
                yield path


def _direction(lane: Lane, segment: int) -> complex:
    """Return the direction of the first or last segment of a lane, as a complex number."""
    step = np.diff(lane.shape, axis=0)[segment] @ np.array([1.0, 1.0j])
    return complex(step / max(abs(step), 1e-9))


def _driven(limits: Array) -> Array:
    """Return the speeds with which points at every `STEP_M` are passed, given the speed limits there, m/s."""
    square, ramp = limits**2, 2.0 * EASE_MPS2 * STEP_M * np.arange(len(limits))
    ahead = np.minimum.accumulate(square - ramp) + ramp
    back = (np.minimum.accumulate(square[::-1] - ramp) + ramp)[::-1]
    return np.asarray(np.sqrt(np.minimum(ahead, back)))


def _points(path: Sequence[Lane]) -> tuple[ComplexArray, IntArray]:
    """Return points at every `STEP_M` of the lanes' centre lines, and for each the index of its lane."""
    shapes = [lane.shape @ np.array([1.0, 1.0j]) for lane in path]
    owners = np.repeat(np.arange(len(path)), [len(shape) for shape in shapes])
    vertices = np.concatenate(shapes)
    stations = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(vertices)))])
    at = np.arange(0.0, stations[-1], STEP_M)
    owner = owners[np.minimum(np.searchsorted(stations, at, side="right"), len(owners) - 1)]
    return np.asarray(np.interp(at, stations, vertices)), np.asarray(owner)
