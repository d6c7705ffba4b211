"""A scenario: a SUMO road network with its demand and its sites."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from isacsim.recording import Lane


@dataclass(frozen=True)
class Site:
    """One ISAC base-station panel.

    x, y: m, in the scenario's plane. height_m: of the antenna above the road.
    azimuth_deg: where the panel faces, compass degrees (0 is +y, 90 is +x), clockwise.
    """

    id: str
    x: float
    y: float
    height_m: float
    azimuth_deg: float


@dataclass(frozen=True)
class Scenario:
    """What a simulation needs of a scenario, read once.

    name: used in shard names and sample ids. network: the .net.xml; demand and additional: SUMO input files, in order.
    origin: (x, y) in SUMO's coordinates of this plane's origin, m: SUMO's coordinates may be UTM ones, which float32
    cannot hold to the centimetre. lanes and sites are in the plane.
    """

    name: str
    network: Path
    demand: tuple[Path, ...]
    additional: tuple[Path, ...]
    origin: tuple[float, float]
    lanes: tuple[Lane, ...]
    sites: tuple[Site, ...]
