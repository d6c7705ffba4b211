"""Writes the lanes of a road as a Lanelet2 map, with its conventions; no reader has a part in it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pyproj import Proj

from isac_cosim.isacsim.scenarios.lane import Lane

UTM = (428333.55, 5539109.82)
"""Origin of the coordinates in UTM, zone 32, m."""


class LaneletMap:
    """A map that is put together border by border."""

    def __init__(self, utm: tuple[float, float] = UTM) -> None:
        self.utm = utm
        self.numbers = itertools.count(1)
        self.nodes: dict[tuple[int, int], tuple[int, float, float]] = {}
        self.ways: list[tuple[int, list[int]]] = []
        self.lanelets: list[tuple[int, int, int, str]] = []

    def node(self, x: float, y: float) -> int:
        """Return the id of a point; points within 10 cm are one."""
        key = (round(x * 10.0), round(y * 10.0))
        if key not in self.nodes:
            self.nodes[key] = (next(self.numbers), x, y)
        return self.nodes[key][0]

    def way(self, points: Sequence[tuple[float, float]] | np.ndarray) -> int:
        """Add a border and return its id, which may also be that of a node."""
        self.ways.append((len(self.ways) + 1, [self.node(float(x), float(y)) for x, y in points]))
        return len(self.ways)

    def lanelet(self, left: int, right: int, subtype: str = "highway") -> int:
        """Add a lanelet and return its id."""
        self.lanelets.append((7000 + len(self.lanelets), left, right, subtype))
        return self.lanelets[-1][0]

    def write(self, file: Path) -> Path:
        """Write the map."""
        to_degrees = Proj("+proj=utm +zone=32 +ellps=WGS84")
        lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='JOSM'>"]
        for number, x, y in self.nodes.values():
            longitude, latitude = to_degrees(x + self.utm[0], y + self.utm[1], inverse=True)
            lines.append(f"  <node id='{number}' visible='true' lat='{latitude:.11f}' lon='{longitude:.11f}' />")
        for number, nodes in self.ways:
            refs = "".join(f"<nd ref='{node}' />" for node in nodes)
            lines.append(f"  <way id='{number}'>{refs}<tag k='type' v='line_thin' /></way>")
        for number, left, right, subtype in self.lanelets:
            members = f"<member type='way' ref='{left}' role='left' /><member type='way' ref='{right}' role='right' />"
            tags = f"<tag k='type' v='lanelet' /><tag k='subtype' v='{subtype}' />"
            lines.append(f"  <relation id='{number}'>{members}{tags}</relation>")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join([*lines, "</osm>"]) + "\n")
        return file


def write_lanelets(file: Path, lanes: Sequence[Lane], utm: tuple[float, float] = UTM) -> Path:
    """Write lanes as a Lanelet2 map, those of an edge with borders between them; every second border is turned."""
    drawn = LaneletMap(utm)
    with_extent = (lane for lane in lanes if np.ptp(lane.shape, axis=0).max() > 0.2)
    by_edge = sorted(with_extent, key=lambda lane: (lane.edge, lane.index))
    for _, of_edge in itertools.groupby(by_edge, lambda lane: lane.edge):
        ordered = list(of_edge)
        borders = [_beside(ordered[0], -0.5), *(_beside(lane, 0.5) for lane in ordered)]
        ways = [drawn.way(points if k % 2 else points[::-1]) for k, points in enumerate(borders)]
        for k in range(len(ordered)):
            drawn.lanelet(ways[k + 1], ways[k])
    return drawn.write(file)


def _beside(lane: Lane, share: float) -> np.ndarray:
    """Return the points that lie a share of a lane's width left of its centre line, (n, 2)."""
    points = lane.shape @ np.array([1.0, 1.0j])
    points = points[np.append(True, np.abs(np.diff(points)) > 0.05)]
    heading = np.gradient(points)
    across = points + 1j * heading / np.abs(heading) * lane.width_m * share
    return np.column_stack([across.real, across.imag])
