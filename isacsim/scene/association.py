"""Which detection is of which track: global nearest neighbour, panel by panel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.scene.detection import Detections

GATE = 20.0
"""Largest normalised squared distance of a detection from the track that it may be of: 99.98 % of chi-square with
three degrees of freedom."""
TRUE_GATE_CELLS = 1.5
"""Where vehicles' true motion associates, a detection is of one at most so far away along each axis, cells."""
EACH, FURTHER = 3, 0.5
"""A body may give so many detections to a panel before one goes rather to another track, and what each further one
costs, as a normalised squared distance: the several points of a body answer nearly as often as one does, while whoever
is beside it may be hidden."""
UNSURE = 5.0
"""What a detection costs a body's track that does not count yet, as a normalised squared distance: it may be of
nothing, as where the echoes of a truck's roof or of two of its sides in one cell seem to be beside it."""
_REFUSED = 1e9


@dataclass(frozen=True)
class Pairs:
    """Detections with their tracks, n of them, and the detections without one.

    track, panel, detection: numbers of each pair, (n,). free: panel and number of each detection without a track.
    """

    track: IntArray
    panel: IntArray
    detection: IntArray
    free: list[tuple[int, int]]


def associate(
    detections: Sequence[Detections],
    predicted: Array,
    variance: Array,
    view: BoolArray,
    counts: BoolArray,
    ambiguity_mps: float,
) -> Pairs:
    """Assign the detections of all panels to tracks: one of each panel to each point, and several to each body.

    predicted: sine, range (m), radial velocity (m/s) of T tracks' J points at I panels, (T, I, J, 3). variance: of a
    detection about the nearest, (T, I, 3). view: which tracks are looked for where, (T, I). counts: which of them
    count, (T,). ambiguity_mps: radial velocities that differ by whole multiples of it look the same.
    """
    cost = [
        np.where(view[:, panel], _distance(of.measured, predicted[:, panel], variance[:, panel], ambiguity_mps), np.inf)
        for panel, of in enumerate(detections)
    ]
    bodies = predicted.shape[2] > 1
    unsure = np.where(counts | (not bodies), 0.0, UNSURE)
    return _assigned(
        [np.where(part < GATE, part + unsure, _REFUSED) for part in cost], bodies, each=EACH if bodies else 1
    )


def associate_truly(
    detections: Sequence[Detections], true: Array, view: BoolArray, per_unit: Array, ambiguity_mps: float
) -> Pairs:
    """Assign the detections of all panels to the vehicles where they truly are; `track` is the vehicle's number.

    true: sine, range (m), radial velocity (m/s) of V vehicles' J points at I panels, (V, I, J, 3). view: who is seen
    where, (V, I). per_unit: cells per unit of the three, (3,).
    """
    parts = []
    for panel, of in enumerate(detections):
        apart = wrapped(of.measured[:, None, None] - true[:, panel], ambiguity_mps) * per_unit
        near = view[:, panel, None] & (np.abs(apart) < TRUE_GATE_CELLS).all(axis=-1)
        parts.append(np.where(near, (apart**2).sum(axis=-1), _REFUSED).min(axis=-1))
    bodies = true.shape[2] > 1
    # A further detection costs nothing: the truth says whose point is the nearest.
    return _assigned(parts, bodies, each=EACH if bodies else 1, further=0.0)


def wrapped(difference: Array, ambiguity_mps: float) -> Array:
    """Return differences of sine, range and radial velocity, (..., 3), with the velocity's ambiguity resolved."""
    result = difference.copy()
    result[..., 2] -= ambiguity_mps * np.rint(result[..., 2] / ambiguity_mps)
    return result


def _distance(measured: Array, predicted: Array, variance: Array, ambiguity_mps: float) -> Array:
    """Return normalised squared distances of D detections from the nearest points of T tracks, (D, T)."""
    apart = wrapped(measured[:, None, None] - predicted, ambiguity_mps)
    return np.asarray((apart**2 / variance[:, None]).sum(axis=-1).min(axis=-1))


def _assigned(costs: Sequence[Array], several: bool, each: int = 1, further: float = FURTHER) -> Pairs:
    """Assign the rows of each panel's costs, (D, T), to the columns where the cost is not refused.

    several: whether rows that are left go to the columns where they cost least. each: rows that a column may have
    before that. further: what each further one costs.
    """
    from scipy.optimize import linear_sum_assignment  # loaded only here, because few commands track scenes

    track, panels, detection, free = [], [], [], []
    for panel, cost in enumerate(costs):
        count = len(cost)
        if not count:
            continue
        possible = (cost < _REFUSED).any(axis=0)
        columns = np.flatnonzero(possible)
        copies = np.tile(columns, each)
        added = np.repeat(further * np.arange(each), len(columns))
        # A row that no column may have pays nothing for the place it is put in.
        rows, chosen = linear_sum_assignment(cost[:, copies] + np.where(cost[:, copies] < _REFUSED, added, 0.0))
        chosen = copies[chosen]
        good = cost[rows, chosen] < _REFUSED
        rows, chosen = rows[good], chosen[good]
        if several and cost.shape[1]:
            more = np.setdiff1d(np.flatnonzero(cost.min(axis=1) < _REFUSED), rows)
            rows = np.concatenate([rows, more])
            chosen = np.concatenate([chosen, cost[more].argmin(axis=1)])
        track.append(chosen)
        panels.append(np.full(len(rows), panel))
        detection.append(rows)
        left = np.ones(count, dtype=bool)
        left[rows] = False
        free += [(panel, k) for k in np.flatnonzero(left).tolist()]
    if not track:
        none = np.empty(0, np.int64)
        return Pairs(none, none, none, free)
    return Pairs(np.concatenate(track), np.concatenate(panels), np.concatenate(detection), free)
