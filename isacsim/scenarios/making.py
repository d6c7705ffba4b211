"""New scenarios, made from a map, from a network alone, or from a SUMO scenario without sites."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import new_folder
from isac_cosim.base.temporary import TemporaryFolder
from isac_cosim.isacsim.scenarios.corners import CORNER_SHIFT_M, SharpCorners, sharp_corners, speed_limits
from isac_cosim.isacsim.scenarios.demand import DemandSettings, make_demand
from isac_cosim.isacsim.scenarios.naming import check_name, name_of
from isac_cosim.isacsim.scenarios.reference_line import RoundingSettings
from isac_cosim.isacsim.scenarios.remarks import remarks
from isac_cosim.isacsim.scenarios.scenario import NoRoadsError, Scenario, load_without_sites, read_network
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings, place, sites_file
from isac_cosim.isacsim.scenarios.sumo_config import encoded
from isac_cosim.isacsim.scenarios.sumo_files import has_demand, is_lefthand, option_path, with_includes
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full
from isac_cosim.isacsim.scenarios.xml_files import elements, one_line, read_through, write_lines

GENERATED = re.compile(rb"<!-- generated on .*?-->\s*", re.DOTALL)
"""What netconvert says of itself in a network: the time, and names of temporary files."""
MAP_ENDINGS = (".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz")
NETCONVERT_OPTIONS = (
    "--geometry.remove",  # nodes that only bend a road become part of its shape
    "--geometry.max-segment-length=25",
    "--roundabouts.guess",
    "--ramps.guess",  # acceleration and deceleration lanes
    "--junctions.join",
    "--tls.guess-signals",
    "--tls.discard-simple",
    "--tls.join",
    "--keep-edges.by-vclass=passenger",
    "--remove-edges.isolated",
    "--no-turnarounds",
    "--output.street-names",
)
"""How netconvert makes a network of a map; its documentation describes each option."""


@dataclass(frozen=True)
class NewScenario:
    """A scenario that was made.

    sites, edges: how many sites it has, and along how many edges. made_demand: whether its demand was made too.
    overridden: options of the user's configuration that are not passed to SUMO. corners: the places on these edges at
    which the road bends too sharply for its speed limit; None where there are none. removed: what SUMO does not get of
    the user's files. remarks: what else their author should know (`isacsim.scenarios.remarks`).
    """

    folder: Path
    sites: int
    edges: int
    made_demand: bool
    overridden: tuple[str, ...] = ()
    corners: SharpCorners | None = None
    removed: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def add_sites(
    where: str,
    out: Path,
    placement: PlacementSettings,
    demand: DemandSettings,
    seed: int = 0,
    corner_shift_m: float = CORNER_SHIFT_M,
) -> NewScenario:
    """Make a scenario in the folder `out`, with sites along the roads that its traffic uses.

    where: a scenario without sites, or a network alone; demand is made where there is none. The new configuration
    names the user's files where they are, and nothing is written beside them. seed: of the demand. corner_shift_m:
    corners of the road that are rounded by more than this are reported, m.
    Raises InputError where something cannot be read, and where `out` is not empty.
    """
    scenario = load_without_sites(where)
    if scenario.sites:
        raise InputError(f"{where} has {len(scenario.sites)} sites already: use it without `network sites`")
    check_name(name_of(out), out)
    with new_folder(out) as folder:
        return _complete(scenario, folder, out, placement, demand, seed, corner_shift_m)


def import_map(
    source: Path,
    out: Path,
    box: tuple[float, float, float, float] | None,
    placement: PlacementSettings,
    demand: DemandSettings,
    seed: int = 0,
    corner_shift_m: float = CORNER_SHIFT_M,
    lefthand: bool = False,
) -> NewScenario:
    """Make a scenario in the folder `out` from an OpenStreetMap file: network, demand and sites.

    box: west, south, east, north, degrees; the whole map when absent. seed: of the demand. corner_shift_m: as in
    `add_sites`. lefthand: whether traffic keeps left there; netconvert does not read that from the map.
    Raises InputError where netconvert cannot read the map, and where `out` is not empty.
    """
    if not source.is_file():
        raise InputError(f"there is no file {source}: give an OpenStreetMap file ({', '.join(MAP_ENDINGS)})")
    if not source.name.endswith(MAP_ENDINGS):
        raise InputError(f"{source} is not an OpenStreetMap file: give one that ends in {', '.join(MAP_ENDINGS)}")
    read_through(source)
    check_name(name_of(out), out)
    with new_folder(out) as folder:
        network = folder / f"{name_of(out)}.net.xml"
        _netconvert(source, network, box, lefthand)
        try:
            roads = read_network(network)
        except NoRoadsError:
            where = " within the box" if box else ""
            raise InputError(
                f"{source} has no connected roads for cars{where}: give another {'box' if box else 'map'}"
            ) from None
        bare = Scenario(
            name_of(out), network, (), (), roads.origin, roads.lanes, (), lefthand=is_lefthand(network),
            elevation=roads.elevation,
        )  # fmt: skip
        return _complete(bare, folder, out, placement, demand, seed, corner_shift_m)


def _complete(
    scenario: Scenario,
    folder: Path,
    out: Path,
    placement: PlacementSettings,
    demand: DemandSettings,
    seed: int,
    corner_shift_m: float,
) -> NewScenario:
    """Write configuration, sites and, where there is none, demand into a folder, which will be renamed to `out`."""
    routes = [*scenario.demand]
    lacks_demand = not has_own_demand(scenario)
    if lacks_demand:
        routes = [folder / f"{name_of(out)}.rou.xml"]
        write_lines(routes[0], make_demand(scenario.network, demand, seed))
    edges = _used_edges((*routes, *scenario.additional)) or {
        lane.edge for lane in scenario.lanes if not lane.edge.startswith(":")
    }
    sites = place(scenario.lanes, edges, placement, scenario.lefthand)
    if not sites:
        raise InputError(f"no site fits beside the roads of {scenario.network}: give a smaller --set-back")
    additional = folder / "sites.add.xml"
    write_lines(additional, sites_file(sites, scenario.origin))

    def named(files: list[Path]) -> str:
        names = (file.name if file.parent == folder else _relative(file, out.resolve()) for file in files)
        return ",".join(map(encoded, names))

    options = {
        "net-file": named([scenario.network]),
        "route-files": named(routes),
        "additional-files": named([*scenario.additional, additional]),
        "begin": in_full(scenario.begin_s),
        **scenario.kept,
    }
    lines = [f"    <{name} value={quoteattr(value)}/>" for name, value in options.items() if value]
    write_lines(folder / f"{name_of(out)}.sumocfg", "\n".join(["<configuration>", *lines, "</configuration>", ""]))
    limits = speed_limits(scenario.network)
    corners = sharp_corners(scenario.lanes, edges, limits, RoundingSettings(), corner_shift_m)
    said = tuple(remarks(scenario))
    return NewScenario(out, len(sites), len(edges), lacks_demand, scenario.overridden, corners, scenario.removed, said)


def has_own_demand(scenario: Scenario) -> bool:
    """Whether a scenario's files name traffic, so that none is made."""
    return any(map(has_demand, (*scenario.demand, *scenario.additional)))


def _relative(file: Path, folder: Path) -> str:
    """The path of a file from a folder; absolute where there is none, between drives of Windows."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:
        return file.resolve().as_posix()


def _used_edges(files: tuple[Path, ...]) -> set[str]:
    """The edges of all routes in these files. Empty where SUMO's router chooses some of the routes."""
    used: set[str] = set()
    for file in (part for named in files for part in with_includes(named)):
        for _, name, attributes in elements(file):
            if name == "trip" or (name == "flow" and "route" not in attributes and "from" in attributes):
                return set()
            if name == "route":
                used.update(attributes.get("edges", "").split())
    return used


def _netconvert(source: Path, network: Path, box: tuple[float, float, float, float] | None, lefthand: bool) -> None:
    """Write the network of a map. Raises InputError with netconvert's reason."""
    options = [*NETCONVERT_OPTIONS]
    if box is not None:
        options.append(f"--keep-edges.in-geo-boundary={','.join(map(str, box))}")
    if lefthand:
        options.append("--lefthand")
    # netconvert too can write in its temporary folder alone.
    made, errors = landlock.confined(lambda: _converted(source, options))
    if made is None:
        reason = one_line(" ".join(line for line in errors.splitlines() if line.startswith("Error")) or errors)
        raise InputError(f"netconvert cannot make a network of {source} ({reason}): fix the map or give another")
    network.write_bytes(GENERATED.sub(b"", made, count=1))


def _converted(source: Path, options: list[str]) -> tuple[bytes | None, str]:
    """Return the network that netconvert makes of a map, None where it fails, and what it says."""
    import sumo

    # netconvert finds projections and the types of OpenStreetMap's roads through SUMO_HOME.
    home = Path(sumo.SUMO_HOME)
    with TemporaryFolder(landlock.folder()) as temporary:
        folder = temporary.path
        types = option_path(home / "data" / "typemap" / "osmNetconvert.typ.xml", folder)
        network = folder / "made.net.xml"
        files = [
            f"--osm-files={option_path(source, folder)}", f"--type-files={types}", f"--output-file={network}"
        ]  # fmt: skip
        process = subprocess.run(
            [str(home / "bin" / "netconvert"), *files, *options],
            env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
        made = network.read_bytes() if process.returncode == 0 and network.is_file() else None
        return made, process.stderr
