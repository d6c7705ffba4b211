"""A witness of datasets that works in the plane: positions of records against the centre lines in a SUMO network file.

It reads the network's XML and the stored states, and uses neither the tool's lanes nor its lane changes. Lanes are
lines: which one a vehicle is nearest to, and on which side of it the next one lies, is a matter of distances.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
Side = Literal["left", "right"]

BESIDE_S = (0.05, 0.7)
"""So long before and after a lane change commits, the vehicle is looked at, s: at least, and at most."""
WITHIN_M = 6.0
"""Lanes further away than this are other roads, m."""
ABREAST_M = 0.5
"""A vehicle is abreast of a lane if the nearest point of its centre line is no further ahead or behind, m."""
SAME_WAY_COS = 0.7
"""Lanes whose direction differs by more than 45 degrees from the vehicle's are crossing or oncoming ones."""


@dataclass(frozen=True)
class Network:
    """The straight pieces of all centre lines: start (k, 2) and step to the end (k, 2), m, and number of the lane (k,).

    lefthand: what the network says about itself.
    """

    start: Points
    step: Points
    lane: npt.NDArray[np.int64]
    lefthand: bool

    @classmethod
    def read(cls, path: Path, origin: tuple[float, float] = (0.0, 0.0)) -> Network:
        """Read a .net.xml. origin: of the dataset's plane in SUMO's coordinates, m."""
        root = ET.parse(path).getroot()
        starts, steps, numbers = [], [], []
        for number, lane in enumerate(root.iter("lane")):
            pairs = [point.split(",")[:2] for point in lane.attrib["shape"].split()]
            line = np.array(pairs, dtype=float) - origin
            starts.append(line[:-1])
            steps.append(np.diff(line, axis=0))
            numbers.append(np.full(len(line) - 1, number))
        lefthand = root.get("lefthand") in ("true", "1")
        return cls(np.concatenate(starts), np.concatenate(steps), np.concatenate(numbers), lefthand)

    def nearest(self, place: Points, velocity: Points) -> list[tuple[float, int, Points, Points]]:
        """Return the lanes that lead a vehicle's way near a place, nearest first, by distance, m.

        Each with its number, the nearest point of its centre line, and the direction of the line there.
        """
        length = np.hypot(*self.step.T)
        share = np.einsum("kc,kc->k", place - self.start, self.step) / np.maximum(length, 1e-9) ** 2
        points = self.start + np.clip(share, 0.0, 1.0)[:, None] * self.step
        away = np.hypot(*(points - place).T)
        direction = self.step / np.maximum(length, 1e-9)[:, None]
        leads = direction @ velocity >= SAME_WAY_COS * np.hypot(*velocity)
        by_lane: dict[int, tuple[float, int, Points, Points]] = {}
        for k in np.flatnonzero(leads & (away < WITHIN_M) & (length > 0)):
            number = int(self.lane[k])
            if number not in by_lane or away[k] < by_lane[number][0]:
                by_lane[number] = (float(away[k]), number, points[k], direction[k])
        return sorted(by_lane.values(), key=lambda lane: lane[0])


@dataclass(frozen=True)
class Verdict:
    """What the plane says of one lane change.

    side: of the lane in which the vehicle ends from the one in which it begins; None if that is not clear.
    off_marking_m: how much nearer it is to one of the two lanes when it commits, m, halved: its distance from the
    marking if both are equally wide.
    """

    side: Side | None
    off_marking_m: float


def judge(network: Network, states: Points, at: int, rate_hz: float) -> Verdict:
    """Judge the lane change of a record. states: (6, S) at rate_hz. at: sample at which it commits.

    The lanes before and after are those of the longest time, within `BESIDE_S`, in which the road does not end.
    """
    least, most = (round(time_s * rate_hz) for time_s in BESIDE_S)
    between = {lane[1]: lane for lane in abreast(network, states[:, at])}
    for beside in range(min(most, at, states.shape[1] - 1 - at), least - 1, -least):
        before, after = (abreast(network, states[:, k]) for k in (at - beside, at + beside))
        numbers = [lanes[0][1] for lanes in (before, after) if lanes and lanes[0][1] in between]
        if len(set(numbers)) == 2:
            source, target = (between[number] for number in numbers)
            gap = target[2] - source[2]
            left = source[3][0] * gap[1] - source[3][1] * gap[0] > 0
            return Verdict("left" if left else "right", abs(source[0] - target[0]) / 2.0)
    return Verdict(None, np.nan)


def abreast(network: Network, state: Points) -> list[tuple[float, int, Points, Points]]:
    """The lanes that a vehicle is abreast of, as in `Network.nearest`. state: (6,)."""
    lanes = network.nearest(state[:2], state[2:4])
    return [lane for lane in lanes if abs((state[:2] - lane[2]) @ lane[3]) < ABREAST_M]


def across(states: Points) -> Points:
    """Return the acceleration across the direction of travel, m/s2, (S,); 0 below 1 m/s."""
    _, _, vx, vy, ax, ay = states
    speed = np.hypot(vx, vy)
    return np.where(speed > 1.0, vx * ay - vy * ax, 0.0) / np.maximum(speed, 1.0)
