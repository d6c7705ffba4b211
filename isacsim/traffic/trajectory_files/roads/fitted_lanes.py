"""Lanes of a freeway, fitted to where vehicles drive that are said to be in them.

Lanes beside each other share the course of their road and differ by an offset, so that a change between two of them is
what a vehicle does, and not what a fit does. Lanes that follow another course, such as ramps, are roads of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.checks import OFF_ROAD_M
from isac_cosim.isacsim.traffic.trajectory_files.observed import Int32Array

BIN_M = 10.0
"""Distance between the points of a centre line, m."""
SMOOTH_M = 60.0
"""Standard deviation of the kernel that the course of the road is smoothed with, m."""
LEAST_STATES = 50
"""Fewer states are no lane."""
LEAST_IN_BIN = 3
LEAST_LANE_M = 30.0
"""A lane in which vehicles are seen over a shorter distance is none, m."""
PARALLEL_M = 0.5
"""A lane follows another course where its place on that of the others varies by more than this, m (rms)."""
SPACING = (0.6, 1.6)
"""Neighbours are so many typical distances apart, at least and at most."""
USUAL_WIDTH_M = 3.66
"""12 feet: the width of a lane that has no neighbour."""


@dataclass(frozen=True)
class FittedLanes:
    """Lanes that were fitted, and the index among them of each state's lane, -1 where it is in none, shape (n,).

    side_by_side: numbers, in the file, of the lanes that are one road, from the left.
    """

    lanes: tuple[Lane, ...]
    number: Int32Array
    side_by_side: tuple[int, ...]


@dataclass(frozen=True)
class _Course:
    """Medians of the lateral positions in one lane, m, shape (b,), NaN where too few vehicles are seen."""

    number: int
    left: Array
    states: int


def fitted_lanes(along: Array, left: Array, lane: IntArray) -> FittedLanes:
    """Return the lanes in which vehicles drive.

    along, left: positions in the plane, m; the road leads to larger x, and left is y, shape (n,). lane: number of the
    lane in the file, from the left and from 1, shape (n,); 0 for no lane. States in lanes side by side are in the one
    in which they are, whatever their number. Without any lane, there are none.
    """
    start, stop = float(np.floor(along.min())), float(np.ceil(along.max()))
    edges = np.linspace(start, stop, max(2, round((stop - start) / BIN_M) + 1))
    courses = [
        course
        for k in np.unique(lane[lane > 0]).tolist()
        if (course := _course(int(k), along, left, lane, edges)) is not None
    ]
    numbers = np.full(len(along), -1, np.int32)
    if not courses:
        return FittedLanes((), numbers, ())
    centres = (edges[1:] + edges[:-1]) / 2.0
    road, offsets, sharing = _common(courses)
    beside = _side_by_side(courses, sharing, offsets)
    main = sorted(beside, key=lambda k: -offsets[k])
    lanes = _main_lanes(main, courses, road, offsets, centres, (start, stop))
    own = offsets[main[::-1]]
    borders = np.concatenate([[own[0] - lanes[0].width_m / 2.0], own + [lane.width_m / 2.0 for lane in lanes]])
    inside = np.isin(lane, [courses[k].number for k in main])
    aside = left[inside] - np.interp(along[inside], centres, road)
    index = np.clip(np.searchsorted(borders, aside, side="right") - 1, 0, len(lanes) - 1)
    on_road = (aside >= borders[0] - OFF_ROAD_M) & (aside <= borders[-1] + OFF_ROAD_M)
    numbers[inside] = np.where(on_road, index, -1)
    for k, course in enumerate(courses):
        if k not in beside:
            numbers[lane == course.number] = len(lanes)
            lanes.append(_own_road(course, centres))
    return FittedLanes(tuple(lanes), numbers, tuple(courses[k].number for k in main))


def _course(number: int, along: Array, left: Array, lane: IntArray, edges: Array) -> _Course | None:
    there = lane == number
    if there.sum() < LEAST_STATES:
        return None
    x, y = along[there], left[there]
    order = np.argsort(x, kind="stable")
    cuts = np.searchsorted(x[order], edges)
    medians = np.full(len(edges) - 1, np.nan)
    for k, (first, after) in enumerate(pairwise(cuts.tolist())):
        if after - first >= LEAST_IN_BIN:
            medians[k] = np.median(y[order[first:after]])
    if np.isfinite(medians).sum() * BIN_M < LEAST_LANE_M:
        return None
    return _Course(number, medians, int(there.sum()))


def _common(courses: list[_Course]) -> tuple[Array, Array, list[int]]:
    """Return the course that lanes share, m, shape (b,), the offset of each lane from it, m, shape (k,), and which do.

    Lanes count by how many states they have. The lane that fits least is left out as long as one does not fit: ramps
    bend no road.
    """
    medians = np.array([course.left for course in courses])
    sharing = list(range(len(courses)))
    while True:
        road = _shared(medians[sharing], [courses[k].states for k in sharing])
        offsets = np.nanmedian(medians - road, axis=1)
        off = np.sqrt(np.nanmean((medians - road - offsets[:, None]) ** 2, axis=1))
        worst = max(sharing, key=lambda k: float(off[k]))
        if off[worst] <= PARALLEL_M or len(sharing) == 1:
            return road, offsets, sharing
        sharing.remove(worst)


def _shared(medians: Array, states: list[int]) -> Array:
    """Return the mean course of lanes, smoothed, shape (b,), apart from an offset. medians: (k, b)."""
    weights = np.where(np.isfinite(medians), np.array(states, float)[:, None], 0.0)
    seen = weights.sum(axis=0) > 0.0
    road, offsets = np.zeros(medians.shape[1]), np.nanmedian(medians, axis=1)
    for _ in range(10):
        apart = np.where(weights > 0.0, medians - offsets[:, None], 0.0)
        means = (weights * apart).sum(axis=0)[seen] / weights.sum(axis=0)[seen]
        road = _smooth(np.interp(np.arange(len(road)), np.flatnonzero(seen), means))
        offsets = np.nanmedian(medians - road, axis=1)
    return road


def _smooth(values: Array) -> Array:
    """Smooth a course; its slope goes on beyond its ends."""
    if len(values) < 3:
        return values
    trend = np.polyval(np.polyfit(np.arange(len(values)), values, 1), np.arange(len(values)))
    return np.asarray(gaussian_filter1d(values - trend, SMOOTH_M / BIN_M, mode="nearest") + trend)


def _side_by_side(courses: list[_Course], parallel: list[int], offsets: Array) -> set[int]:
    """Return the places in the list of the lanes that lie beside each other without a gap, the busiest among them.

    parallel: the places of the lanes that share a course.
    """
    busiest = max(parallel, key=lambda k: courses[k].states)
    order = sorted(parallel, key=lambda k: -offsets[k])
    gaps = -np.diff(offsets[order])
    usual = float(np.median(gaps)) if len(gaps) else USUAL_WIDTH_M
    low, high = (share * usual for share in SPACING)
    groups: list[list[int]] = [[order[0]]]
    for k, gap in zip(order[1:], gaps.tolist(), strict=True):
        if low <= gap <= high:
            groups[-1].append(k)
        else:
            groups.append([k])
    return set(next(group for group in groups if busiest in group))


def _main_lanes(
    main: list[int], courses: list[_Course], road: Array, offsets: Array, centres: Array, ends: tuple[float, float]
) -> list[Lane]:
    """Return the lanes side by side, from the rightmost one: their widths meet at the markings between them."""
    rightmost_first = main[::-1]
    gaps = np.diff(offsets[rightmost_first])
    width = float(gaps.mean()) if len(gaps) else USUAL_WIDTH_M
    meeting = (np.eye(len(gaps), len(main)) + np.eye(len(gaps), len(main), 1)) / 2.0
    widths = width + (np.linalg.lstsq(meeting, gaps - width, rcond=None)[0] if len(gaps) else np.zeros(1))
    at = np.concatenate([[ends[0]], centres, [ends[1]]])
    course = np.concatenate([[road[0]], road, [road[-1]]])
    lanes = []
    for index, (k, wide) in enumerate(zip(rightmost_first, widths.tolist(), strict=True)):
        shape = np.column_stack([at, course + offsets[k]])
        length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
        lanes.append(Lane(f"road_{courses[k].number}", "road", index, wide, length, shape, ()))
    return lanes


def _own_road(course: _Course, centres: Array) -> Lane:
    seen = np.isfinite(course.left)
    shape = np.column_stack([centres[seen], _smooth(course.left[seen])])
    shape = np.concatenate([[2 * shape[0] - shape[1]], shape, [2 * shape[-1] - shape[-2]]])
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    return Lane(f"lane{course.number}_0", f"lane{course.number}", 0, USUAL_WIDTH_M, length, shape, ())
