"""How tracks begin: a detection without a track, put on the road's map, is taken for a vehicle that drives along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.isacsim.scene.road import RoadMap

FASTEST_MPS = 60.0
"""Nobody is taken to drive faster."""
LEAST_COSINE = 0.25
"""A radial velocity tells the speed along the road where the line of sight is not squarer to it than this."""
APART_ALONG_M, APART_ACROSS_M, APART_SHARE = 2.5, 1.6, 0.012
"""A detection nearer to a track than this is not of another vehicle: along and across its way, and across as a share of
the distance from the panel."""
BIRTH_CELLS = 0.1
"""Standard deviation that is allowed to the detection that a track begins with, cells."""
LEAST_GROUND_M = 2.0
"""Detections from nearer than this to the foot of a mast are not used."""


@dataclass(frozen=True)
class Birth:
    """A new track. state: x, y, vx, vy, ax, ay, (6,). covariance: (6, 6). power: of its detection over the noise."""

    state: Array
    covariance: Array
    power: float


def births(
    free: Sequence[tuple[int, int]],
    owners: Sequence[str | None],
    detections: Sequence[Detections],
    states: Array,
    panels: Panels,
    road: RoadMap,
    ambiguity_mps: float,
    per_unit: Array,
) -> list[tuple[Birth, str | None]]:
    """Return the tracks that begin, the nearest to their panels first, each with its vehicle where that is known.

    free, owners: panel and number of each detection without a track, and its vehicle. states: of the tracks that there
    are, (T, 6). Where the vehicle is known, one track begins for each.
    """
    order = sorted(range(len(free)), key=lambda k: float(detections[free[k][0]].measured[free[k][1], 1]))
    born: list[tuple[Birth, str | None]] = []
    there = list(states)
    owned: set[str] = set()
    for k in order:
        (panel, number), owner = free[k], owners[k]
        if owner in owned:
            continue
        of = detections[panel]
        birth = _birth(of.measured[number], float(of.power[number]), panel, panels, road, ambiguity_mps, per_unit)
        if birth is None or (owner is None and _taken(birth, there, float(of.measured[number, 1]))):
            continue
        born.append((birth, owner))
        there.append(birth.state)
        if owner is not None:
            owned.add(owner)
    return born


def _birth(
    measured: Array, power: float, panel: int, panels: Panels, road: RoadMap, ambiguity_mps: float, per_unit: Array
) -> Birth | None:
    """Return the track that a detection begins; None if it is not on a road, or its speed cannot be told."""
    sine, distance, radial = measured.tolist()
    height, right, front = float(panels.height_m[panel]), panels.right[panel], panels.front[panel]
    beside = distance * sine
    ahead_squared = distance**2 - height**2 - beside**2
    if ahead_squared <= 0 or distance < abs(height) + LEAST_GROUND_M:
        return None
    ground = beside * right + np.sqrt(ahead_squared) * front
    position = np.array([panels.x[panel], panels.y[panel]]) + ground
    for direction in road.directions(position):
        cosine = float(direction @ ground) / distance
        if abs(cosine) < LEAST_COSINE:
            continue
        speeds = [(radial + turns * ambiguity_mps) / cosine for turns in (0, -1, 1)]
        slack = 1.0 / per_unit[2] / abs(cosine)
        speed = next((value for value in speeds if -slack <= value <= FASTEST_MPS), None)
        if speed is None:
            continue
        state = np.concatenate([position, max(speed, 0.0) * direction, np.zeros(2)])
        sight = ground / np.hypot(*ground)
        cross = np.array([-sight[1], sight[0]])
        squareness = max(float(front @ sight), 0.3)
        sd_along = BIRTH_CELLS / per_unit[1] * distance / float(np.hypot(*ground))
        sd_cross = BIRTH_CELLS / per_unit[0] * distance / squareness
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = np.outer(sight, sight) * sd_along**2 + np.outer(cross, cross) * sd_cross**2
        speed_sd = BIRTH_CELLS / per_unit[2] / abs(cosine) + 0.5
        covariance[2:4, 2:4] = np.outer(direction, direction) * speed_sd**2 + np.eye(2) * 0.8**2
        covariance[4:, 4:] = np.eye(2) * 1.5**2
        return Birth(state, covariance, power)
    return None


def _taken(birth: Birth, states: Sequence[Array], distance: float) -> bool:
    """Return whether a track is there already. distance: from the panel, m."""
    if not states:
        return False
    there = np.array(states)
    apart = birth.state[:2] - there[:, :2]
    near = np.abs(apart).max(axis=1) < APART_ALONG_M + APART_ACROSS_M + APART_SHARE * distance
    if not near.any():
        return False
    speed = np.maximum(np.hypot(there[near, 2], there[near, 3]), 1e-6)
    ahead = np.where(speed[:, None] > 0.5, there[near, 2:4] / speed[:, None], birth.state[2:4])
    norm = np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-6)
    ahead = ahead / norm[:, None]
    along = np.abs((ahead * apart[near]).sum(axis=1))
    across = np.abs(ahead[:, 0] * apart[near, 1] - ahead[:, 1] * apart[near, 0])
    return bool(((along < APART_ALONG_M) & (across < max(APART_ACROSS_M, APART_SHARE * distance))).any())
