"""A scenario: a SUMO road network with its demand and its sites."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import sumolib.net

from isacsim.errors import InputError
from isacsim.scenarios.lane import Lane
from isacsim.scenarios.sumo_files import (
    CONFIG_ENDINGS,
    NETWORK_ENDINGS,
    Inputs,
    has_demand,
    one_line,
    parse,
    read_config,
    refuse_document_type,
    refuse_outputs,
)

SITE_TYPE = "isac_site"
PLANE_REACH_M = 10_000.0
"""A network that keeps within this of SUMO's origin keeps SUMO's coordinates."""


class NoRoadsError(InputError):
    """A network holds nothing that a car could drive on."""


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
    begin_s: simulation time at which it starts, s. kept: options of its configuration that SUMO gets. overridden: those
    that the tool sets itself (its time base) or leaves out (outputs, logs, windows).
    """

    name: str
    network: Path
    demand: tuple[Path, ...]
    additional: tuple[Path, ...]
    origin: tuple[float, float]
    lanes: tuple[Lane, ...]
    sites: tuple[Site, ...]
    begin_s: float = 0.0
    kept: Mapping[str, str] = field(default_factory=dict)
    overridden: tuple[str, ...] = ()


def bundled() -> dict[str, Path]:
    """The scenarios that ship with the tool: folder by name."""
    root = Path(str(importlib.resources.files("sumo_nets")))
    return {folder.name: folder for folder in sorted(root.iterdir()) if any(folder.glob("*.sumocfg"))}


def load(where: str | Path) -> Scenario:
    """Read a scenario: a bundled one's name, a folder with one SUMO configuration, or a configuration.

    Nothing is written. Raises InputError for what is missing or cannot be read.
    """
    scenario = load_without_sites(where)
    if not any(map(has_demand, (*scenario.demand, *scenario.additional))):
        raise InputError(f"{where} has no demand: `cosim network sites {where} -o FOLDER` makes a scenario with some")
    if not scenario.sites:
        raise InputError(f"{where} has no sites: `cosim network sites {where} -o FOLDER` makes a scenario with some")
    return scenario


def load_without_sites(where: str | Path) -> Scenario:
    """As `load`, for a scenario that may still lack sites or demand; a network alone will do."""
    name, file = _find(Path(where))
    alone = file.name.endswith(NETWORK_ENDINGS)
    inputs = Inputs(file, (), (), 0.0, {}, ()) if alone else read_config(file)
    for each in (inputs.network, *inputs.demand):
        refuse_document_type(each)
        refuse_outputs(each)
    lanes, origin = read_network(inputs.network)
    sites = tuple(_read_sites(inputs.additional, origin))
    return Scenario(
        name, inputs.network, inputs.demand, inputs.additional, origin, lanes, sites,
        inputs.begin_s, inputs.kept, inputs.overridden,
    )  # fmt: skip


def read_network(network: Path) -> tuple[tuple[Lane, ...], tuple[float, float]]:
    """Lanes of a network, junction-internal ones included, and the origin of their plane in SUMO's coordinates."""
    refuse_document_type(network)
    try:
        lanes, origin = _lanes(sumolib.net.readNet(str(network), withInternal=True))
    except Exception as error:  # the reader raises whatever it meets
        raise InputError(f"{network} cannot be read as a SUMO network: {one_line(error)}") from None
    if all(lane.edge.startswith(":") for lane in lanes):
        raise NoRoadsError(f"{network} is a network without roads: give another")
    for lane in lanes:
        if not (np.isfinite(lane.shape).all() and 0 < lane.width_m < np.inf and 0 < lane.length_m < np.inf):
            raise InputError(f"{network}: lane {lane.id} has no finite shape, width and length: mend the network")
    return lanes, origin


def _lanes(net: Any) -> tuple[tuple[Lane, ...], tuple[float, float]]:
    """`read_network` of what sumolib read."""
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
            successors=tuple(sorted({link.getViaLaneID() or link.getToLane().getID() for link in lane.getOutgoing()})),
        )
        for edge in net.getEdges(withInternal=True)
        for lane in edge.getLanes()
    )
    return lanes, origin


def _find(where: Path) -> tuple[str, Path]:
    """Name of what the user named, and its SUMO configuration or network."""
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
    for ending in NETWORK_ENDINGS:
        if where.name.endswith(ending):
            return where.name.removesuffix(ending), where
    raise InputError(f"{where} is no scenario: give a folder with a .sumocfg, a .sumocfg, or a .net.xml")


def _read_sites(additional: Iterable[Path], origin: tuple[float, float]) -> Iterable[Site]:
    """The sites among the POIs of additional files."""
    for file in additional:
        for poi in parse(file).iter("poi"):
            if poi.get("type") != SITE_TYPE:
                continue
            params = {p.get("key"): p.get("value") for p in poi.iter("param")}
            try:
                x, y = float(poi.attrib["x"]), float(poi.attrib["y"])
                height, azimuth = float(params["height"] or ""), float(params["azimuth"] or "")
                if not np.isfinite((x, y, height, azimuth)).all():
                    raise ValueError
                yield Site(poi.attrib["id"], x - origin[0], y - origin[1], height, azimuth)
            except (KeyError, ValueError):
                raise InputError(
                    f"{file}: site {poi.get('id')} needs numbers x and y, and params height (m) and azimuth (degrees)"
                ) from None
