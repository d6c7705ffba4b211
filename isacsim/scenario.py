"""A scenario: a SUMO road network with its demand and its sites."""

from __future__ import annotations

import importlib.resources
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sumolib.net

from isacsim.errors import InputError
from isacsim.recording import Lane

SITE_TYPE = "isac_site"
CONFIG_ENDINGS = (".sumocfg", ".sumo.cfg")
NETWORK_ENDINGS = (".net.xml", ".net.xml.gz")
PLANE_REACH_M = 10_000.0
"""A network that keeps within this of SUMO's origin keeps SUMO's coordinates."""


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


def bundled() -> dict[str, Path]:
    """The scenarios that ship with the tool: folder by name."""
    root = Path(str(importlib.resources.files("sumo_nets")))
    return {folder.name: folder for folder in sorted(root.iterdir()) if any(folder.glob("*.sumocfg"))}


def load(where: str | Path) -> Scenario:
    """Read a scenario: a bundled one's name, a folder with one SUMO configuration, or a configuration.

    Nothing is written. Raises InputError for what is missing or cannot be read.
    """
    name, config = _find(Path(where))
    network, demand, additional = _inputs(config)
    if not demand:
        raise InputError(f"{config} names no route-files: without demand there is no traffic; add some")
    lanes, origin = read_network(network)
    sites = tuple(_read_sites(additional, origin))
    if not sites:
        raise InputError(
            f"{config} has no sites: name an additional file with <poi type=\"{SITE_TYPE}\" …> in its additional-files"
        )
    return Scenario(name, network, demand, additional, origin, lanes, sites)


def read_network(network: Path) -> tuple[tuple[Lane, ...], tuple[float, float]]:
    """Lanes of a network, junction-internal ones included, and the origin of their plane in SUMO's coordinates."""
    try:
        net = sumolib.net.readNet(str(network), withInternal=True)
    except Exception as error:  # the reader raises whatever its parser meets
        raise InputError(f"{network} cannot be read as a SUMO network: {_one_line(error)}") from None
    low_x, low_y, high_x, high_y = net.getBoundary()
    if max(map(abs, (low_x, low_y, high_x, high_y))) <= PLANE_REACH_M:
        origin = (0.0, 0.0)
    else:
        origin = (round((low_x + high_x) / 2e3) * 1e3, round((low_y + high_y) / 2e3) * 1e3)
    lanes = tuple(
        Lane(
            id=lane.getID(),
            edge=edge.getID(),
            index=lane.getIndex(),
            width_m=lane.getWidth(),
            length_m=lane.getLength(),
            shape=np.array([point[:2] for point in lane.getShape()], dtype=float) - origin,
            successors=tuple(
                sorted({link.getViaLaneID() or link.getToLane().getID() for link in lane.getOutgoing()})
            ),
        )
        for edge in net.getEdges(withInternal=True)
        for lane in edge.getLanes()
    )
    return lanes, origin


def _find(where: Path) -> tuple[str, Path]:
    """Name and SUMO configuration of what the user named."""
    if not where.exists():
        known = bundled()
        if str(where) not in known:
            raise InputError(f"there is no scenario {where}: give a folder, a .sumocfg, or one of {', '.join(known)}")
        where = known[str(where)]
    if where.is_dir():
        found = sorted(file for ending in CONFIG_ENDINGS for file in where.glob(f"*{ending}"))
        if len(found) != 1:
            raise InputError(f"{where} holds {len(found)} SUMO configurations (.sumocfg): name the one meant")
        return where.resolve().name, found[0]
    for ending in CONFIG_ENDINGS:
        if where.name.endswith(ending):
            return where.name.removesuffix(ending), where
    if where.name.endswith(NETWORK_ENDINGS):
        raise InputError(f"{where} is a network alone: write a .sumocfg that names it, its demand and its sites")
    raise InputError(f"{where} is no scenario: give a folder with a .sumocfg, or a .sumocfg")


def _inputs(config: Path) -> tuple[Path, tuple[Path, ...], tuple[Path, ...]]:
    """Network, route files and additional files that a SUMO configuration names, each shown to exist."""
    root = _parse(config)

    def files(option: str) -> tuple[Path, ...]:
        values = [node.get("value", "") for node in root.iter() if _option(node.tag) == option]
        names = [name.strip() for value in values for name in value.split(",") if name.strip()]
        return tuple(config.parent / os.path.expandvars(name) for name in names)

    networks, demand, additional = files("net-file"), files("route-files"), files("additional-files")
    if len(networks) != 1:
        raise InputError(f"{config} names {len(networks)} networks: give it one <net-file value=…/>")
    for file in (*networks, *demand, *additional):
        if not file.is_file():
            raise InputError(f"{config} names {file.name}, which is not there: add it or take its name out")
    return networks[0], demand, additional


def _option(tag: str) -> str:
    """SUMO's long option name of a configuration element, which may be written by its synonym."""
    synonyms = {"net": "net-file", "n": "net-file", "routes": "route-files", "r": "route-files"}
    return synonyms.get(tag, {"additional": "additional-files", "a": "additional-files"}.get(tag, tag))


def _read_sites(additional: Iterable[Path], origin: tuple[float, float]) -> Iterable[Site]:
    """The sites among the POIs of additional files."""
    for file in additional:
        for poi in _parse(file).iter("poi"):
            if poi.get("type") != SITE_TYPE:
                continue
            params = {p.get("key"): p.get("value") for p in poi.iter("param")}
            try:
                yield Site(
                    id=poi.attrib["id"],
                    x=float(poi.attrib["x"]) - origin[0],
                    y=float(poi.attrib["y"]) - origin[1],
                    height_m=float(params["height"] or ""),
                    azimuth_deg=float(params["azimuth"] or ""),
                )
            except (KeyError, ValueError):
                raise InputError(
                    f"{file}: site {poi.get('id')} needs numbers x and y, and params height (m) and azimuth (degrees)"
                ) from None


def _parse(file: Path) -> ET.Element:
    try:
        return ET.parse(file).getroot()
    except (ET.ParseError, OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file} cannot be read as XML: {_one_line(error)}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
