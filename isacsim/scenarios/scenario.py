"""A scenario: a SUMO road network with its demand and its sites."""

from __future__ import annotations

import importlib.resources
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import sumolib.net

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import nearest
from isac_cosim.isacsim.scenarios.demand_order import refused_types
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.naming import check_name, name_of
from isac_cosim.isacsim.scenarios.sumo_config import Inputs, read_config
from isac_cosim.isacsim.scenarios.sumo_files import (
    CONFIG_ENDINGS,
    NETWORK_ENDINGS,
    cleaned,
    has_demand,
    is_lefthand,
    removed_from,
    with_includes,
)
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full
from isac_cosim.isacsim.scenarios.xml_files import elements, one_line

SITE_TYPE = "isac_site"
PLANE_REACH_M = 10_000.0
"""A network that keeps within this of SUMO's origin keeps SUMO's coordinates."""
HIGHEST_SITE_M = 1000.0
"""Sites are above the road, and at most so high, m."""
LEVEL_M = 1.0
"""An edge whose points are all within this of the median height of its network counts as level, m."""


class NoRoadsError(InputError):
    """A network has no road at all."""


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
class Elevation:
    """How far a network is from the plane that it is taken for.

    edges: how many of the `of` edges leave the median height by more than `LEVEL_M`. low_m, high_m: the lowest and the
    highest point of the network, m, above or below that height.
    """

    edges: int
    of: int
    low_m: float
    high_m: float


@dataclass(frozen=True)
class RoadNetwork:
    """What is read of a network: its lanes, also those inside junctions, and the origin of their plane, m.

    elevation: None where all edges are level.
    """

    lanes: tuple[Lane, ...]
    origin: tuple[float, float]
    elevation: Elevation | None = None


@dataclass(frozen=True)
class Scenario:
    """A road network with its demand and its sites, as a simulation needs them.

    name: used in shard names and sample ids.
    network: the .net.xml. demand, additional: SUMO input files, in order.
    origin: origin of the scenario's plane in SUMO's coordinates (x, y), m. SUMO's coordinates may be UTM ones, which
    float32 cannot hold to the centimetre.
    lanes, sites: in the plane.
    begin_s: simulation time at which the scenario starts, s.
    kept: options of the user's configuration that are passed to SUMO, by name.
    overridden: names of those that are set otherwise (step length, seed) or left out (outputs, logs, windows).
    removed: what SUMO does not get of the files, because it makes SUMO write a file or is in none of SUMO's schemas.
    lefthand: whether traffic keeps left. SUMO simulates such a network as the mirror image of one where it keeps right:
    lanes are numbered from the left, and what SUMO calls left is right in the plane.
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
    lefthand: bool = False
    removed: tuple[str, ...] = ()
    elevation: Elevation | None = None


def bundled() -> dict[str, Path]:
    """Return the folders of the bundled scenarios, by name."""
    root = Path(str(importlib.resources.files("isac_cosim.sumo_nets")))
    return {folder.name: folder for folder in sorted(root.iterdir()) if any(folder.glob("*.sumocfg"))}


def load(where: str | Path) -> Scenario:
    """Read a scenario with demand and sites.

    where: name of a bundled scenario, a folder with one SUMO configuration, or a configuration.
    Nothing is written. Raises InputError where something is missing or cannot be read.
    """
    scenario = load_without_sites(where)
    check_name(scenario.name, where)
    if not any(map(has_demand, (*scenario.demand, *scenario.additional))):
        raise InputError(
            f"{where} has no demand: make a scenario with demand by `cosim network sites {where} -o FOLDER`"
        )
    if not scenario.sites:
        raise InputError(f"{where} has no sites: make a scenario with sites by `cosim network sites {where} -o FOLDER`")
    return scenario


def load_without_sites(where: str | Path) -> Scenario:
    """Read a scenario that may lack demand and sites: as `load`, and a .net.xml alone is enough."""
    name, path = _find(Path(where))
    network_alone = path.name.endswith(NETWORK_ENDINGS)
    inputs = Inputs(path, (), (), 0.0, {}, ()) if network_alone else read_config(path)
    removed = removed_from((inputs.network, *inputs.demand, *inputs.additional))
    roads = read_network(inputs.network)
    sites = tuple(read_sites(inputs.additional, roads.origin))
    _refuse_types((*inputs.demand, *inputs.additional))
    return Scenario(
        name, inputs.network, inputs.demand, inputs.additional, roads.origin, roads.lanes, sites,
        inputs.begin_s, inputs.kept, inputs.overridden, is_lefthand(inputs.network), removed, roads.elevation,
    )  # fmt: skip


def _refuse_types(files: tuple[Path, ...]) -> None:
    """Raise InputError where a vehicle type changes lanes by a model that SUMO's sublane simulation refuses."""
    if refused := refused_types(files):
        file, name, model = refused[0]
        others = f" (and {len(refused) - 1} more types)" if len(refused) > 1 else ""
        raise InputError(
            f"{file}: vehicle type {name!r} has laneChangeModel {model}{others}, but vehicles change lanes by SUMO's "
            "sublane model: remove the attribute, or set it to SL2015"
        )


def read_network(network: Path) -> RoadNetwork:
    """Return what is read of a network.

    Raises InputError where the network cannot be read, NoRoadsError where it has no road.
    """
    try:
        with cleaned(network) as readable:
            net = sumolib.net.readNet(str(readable), withInternal=True)
            (lanes, origin), elevation = _lanes(net), _elevation(net)
    except InputError:
        raise
    except Exception as error:  # the reader raises whatever it meets
        raise InputError(f"{network} cannot be read as a SUMO network ({one_line(error)}): fix the file") from None
    if all(lane.edge.startswith(":") for lane in lanes):
        raise NoRoadsError(f"{network} has no roads: give another network")
    for lane in lanes:
        if not (np.isfinite(lane.shape).all() and 0 < lane.width_m < np.inf and 0 < lane.length_m < np.inf):
            raise InputError(
                f"{network}: the shape, width or length of lane {lane.id} is zero or not finite: fix the network"
            )
    return RoadNetwork(lanes, origin, elevation)


def _lanes(net: Any) -> tuple[tuple[Lane, ...], tuple[float, float]]:
    """The lanes and origin of a network that sumolib has read."""
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


def _elevation(net: Any) -> Elevation | None:
    """Return how far a network that sumolib has read is from a plane; None where all its edges are level."""
    edges = net.getEdges(withInternal=False)
    heights = [[point[2] for lane in edge.getLanes() for point in lane.getShape3D()] for edge in edges]
    every = np.concatenate([*map(np.asarray, heights), np.empty(0)])
    middle = float(np.median(every)) if len(every) else 0.0
    off = sum(max(abs(height - middle) for height in of_edge) > LEVEL_M for of_edge in heights)
    if not off:
        return None
    return Elevation(off, len(heights), float(every.min()) - middle, float(every.max()) - middle)


def _find(where: Path) -> tuple[str, Path]:
    """The name of the scenario that the user gave, and the path of its SUMO configuration or network."""
    folders = bundled()
    if _is_bundled(where) or not where.exists():
        if str(where) not in folders:
            raise InputError(
                f"there is no scenario {where}: {nearest(str(where), folders)}"
                f"give a folder, a .sumocfg, a .net.xml, or one of {', '.join(folders)}"
            )
        where = folders[str(where)]
    if where.is_dir():
        return name_of(where), _config_in(where)
    for ending in (*CONFIG_ENDINGS, *NETWORK_ENDINGS):
        if where.name.endswith(ending):
            return unicodedata.normalize("NFC", where.name.removesuffix(ending)), where
    raise InputError(
        f"{where} is not a scenario: give a folder with a .sumocfg, a .sumocfg, or a .net.xml; of a file of "
        "trajectories, give the source"
    )


def resolved(where: str) -> str:
    """Return a scenario's path made absolute, because workers may run elsewhere; the name of a bundled one as it is."""
    path = Path(where)
    return str(path.resolve()) if path.exists() and not _is_bundled(path) else where


def _is_bundled(where: Path) -> bool:
    """Whether a bundled scenario is meant, also beside a folder of the same name that holds no scenario."""
    if str(where) not in bundled():
        return False
    endings = (*CONFIG_ENDINGS, *NETWORK_ENDINGS)
    return not where.exists() or (where.is_dir() and not any(path.name.endswith(endings) for path in where.iterdir()))


def _config_in(folder: Path) -> Path:
    """The one SUMO configuration of a folder. Raises InputError, which names what else the folder offers."""
    configs, networks = (
        sorted(file for ending in endings for file in folder.glob(f"*{ending}"))
        for endings in (CONFIG_ENDINGS, NETWORK_ENDINGS)
    )
    if len(configs) == 1:
        return configs[0]
    if configs:
        names = ", ".join(config.name for config in configs)
        raise InputError(f"{folder} has {len(configs)} SUMO configurations ({names}): give the path of one")
    if networks:
        raise InputError(
            f"{folder} has no SUMO configuration (.sumocfg), but a network, and a .net.xml will do: make a scenario "
            f"of it by `cosim network sites {networks[0]} -o FOLDER`"
        )
    raise InputError(
        f"{folder} has no SUMO configuration (.sumocfg) and no network (.net.xml): give the path of one, or a folder "
        "that has one"
    )


def read_sites(additional: Iterable[Path], origin: tuple[float, float]) -> Iterable[Site]:
    """Yield the sites among the points of interest (POIs) of additional files.

    origin: of the scenario's plane in the files' coordinates, m. Raises InputError where a site lacks a number.
    """
    for file in (path for named in additional for path in with_includes(named)):
        for poi, params in _pois(file):
            try:
                x, y = float(poi["x"]), float(poi["y"])
                height, azimuth = float(params["height"]), float(params["azimuth"])
                if not np.isfinite((x, y, height, azimuth)).all():
                    raise ValueError
                if not 0.0 < height <= HIGHEST_SITE_M:
                    raise InputError(
                        f"{file}: site {poi.get('id')} is {in_full(height)} m high: give the height of its antenna "
                        f"above the road, more than 0 and at most {in_full(HIGHEST_SITE_M)} m"
                    )
                yield Site(poi["id"], x - origin[0], y - origin[1], height, azimuth)
            except (KeyError, ValueError):
                raise InputError(
                    f"{file}: site {poi.get('id')} needs numbers x and y, and params height (m) and azimuth (degrees): "
                    "add or fix them"
                ) from None


def _pois(file: Path) -> list[tuple[dict[str, str], dict[str, str]]]:
    """The attributes and the parameters of those points of interest of a file that are sites."""
    found: list[tuple[dict[str, str], dict[str, str]]] = []
    inside: int | None = None  # the depth of the site that is being read
    for depth, name, attributes in elements(file):
        if inside is not None and depth > inside:
            if name == "param":
                found[-1][1][attributes.get("key", "")] = attributes.get("value", "")
            continue
        inside = None
        if name == "poi" and attributes.get("type") == SITE_TYPE:
            found.append((attributes, {}))
            inside = depth
    return found
