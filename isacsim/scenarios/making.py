"""Scenarios made from what a user has: a map, a network alone, or a SUMO scenario without sites."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from isacsim.errors import InputError
from isacsim.scenarios.demand import DemandSettings, make_demand
from isacsim.scenarios.scenario import NoRoadsError, Scenario, load_without_sites, read_network
from isacsim.scenarios.site_placement import PlacementSettings, place, sites_file
from isacsim.scenarios.sumo_files import has_demand, one_line, parse, refuse_document_type

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
"""How a map becomes a network; see netconvert's own documentation of each."""


@dataclass(frozen=True)
class Made:
    """What was made: the scenario's folder and what is in it; options of the user's configuration that are not kept."""

    folder: Path
    sites: int
    edges: int
    made_demand: bool
    overridden: tuple[str, ...] = ()


def add_sites(where: str, out: Path, placement: PlacementSettings, demand: DemandSettings, seed: int = 0) -> Made:
    """Make a scenario folder of a user's scenario or bare network, with sites along the roads that its traffic uses.

    Network and demand are named where they are; demand is made where there is none. Nothing is written beside them.
    Raises InputError for what cannot be read, and where `out` is taken.
    """
    scenario = load_without_sites(where)
    if scenario.sites:
        raise InputError(f"{where} has {len(scenario.sites)} sites already: use it as it is")
    with _new_folder(out) as folder:
        return _complete(scenario, folder, out, placement, demand, seed)


def import_map(
    source: Path,
    out: Path,
    box: tuple[float, float, float, float] | None,
    placement: PlacementSettings,
    demand: DemandSettings,
    seed: int = 0,
) -> Made:
    """Make a scenario folder of an OpenStreetMap file: network, demand and sites.

    box: west, south, east, north, degrees; all of the map when absent.
    Raises InputError where netconvert refuses the map, and where `out` is taken.
    """
    if not source.is_file():
        raise InputError(f"there is no map {source}: give an OpenStreetMap file ({', '.join(MAP_ENDINGS)})")
    if not source.name.endswith(MAP_ENDINGS):
        raise InputError(f"{source} is no OpenStreetMap file by its name: it should end in {', '.join(MAP_ENDINGS)}")
    refuse_document_type(source)
    with _new_folder(out) as folder:
        network = folder / f"{out.name}.net.xml"
        _netconvert(source, network, box)
        try:
            lanes, origin = read_network(network)
        except NoRoadsError:
            inside = " in the box" if box else ""
            raise InputError(
                f"{source} holds no connected roads for cars{inside}: give another {'box' if box else 'map'}"
            ) from None
        bare = Scenario(out.name, network, (), (), origin, lanes, ())
        return _complete(bare, folder, out, placement, demand, seed)


def _complete(
    scenario: Scenario, folder: Path, out: Path, placement: PlacementSettings, demand: DemandSettings, seed: int
) -> Made:
    """Write the configuration, sites and, where there is none, demand into a scenario's folder (later: out)."""
    routes = [*scenario.demand]
    making = not any(map(has_demand, (*scenario.demand, *scenario.additional)))
    if making:
        made = folder / f"{out.name}.rou.xml"
        made.write_text(make_demand(scenario.network, demand, seed))
        routes = [made]
    edges = _used_edges((*routes, *scenario.additional)) or {
        lane.edge for lane in scenario.lanes if not lane.edge.startswith(":")
    }
    sites = place(scenario.lanes, edges, placement)
    if not sites:
        raise InputError(f"no pole fits beside the roads of {scenario.network}: try a smaller --set-back")
    additional = folder / "sites.add.xml"
    additional.write_text(sites_file(sites, scenario.origin))

    def named(files: list[Path]) -> str:
        inside = [file.name if file.parent == folder else os.path.relpath(file, out.resolve()) for file in files]
        return ",".join(inside)

    options = {
        "net-file": named([scenario.network]),
        "route-files": named(routes),
        "additional-files": named([*scenario.additional, additional]),
        "begin": f"{scenario.begin_s:g}",
        **scenario.kept,
    }
    lines = [f'    <{name} value="{value}"/>' for name, value in options.items() if value]
    (folder / f"{out.name}.sumocfg").write_text("\n".join(["<configuration>", *lines, "</configuration>", ""]))
    return Made(out, len(sites), len(edges), making, scenario.overridden)


def _used_edges(files: tuple[Path, ...]) -> set[str]:
    """Edges of the routes that files spell out; none where trips leave them to SUMO's router."""
    used: set[str] = set()
    for file in files:
        for node in parse(file).iter():
            if node.tag == "trip" or (node.tag == "flow" and "route" not in node.attrib and "from" in node.attrib):
                return set()
            if node.tag == "route":
                used.update(node.get("edges", "").split())
    return used


def _netconvert(source: Path, network: Path, box: tuple[float, float, float, float] | None) -> None:
    import sumo

    # netconvert finds projections and the types of OpenStreetMap's roads through SUMO_HOME.
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    types = Path(sumo.SUMO_HOME) / "data" / "typemap" / "osmNetconvert.typ.xml"
    options = [*NETCONVERT_OPTIONS, f"--type-files={types}"]
    if box is not None:
        options.append(f"--keep-edges.in-geo-boundary={','.join(map(str, box))}")
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), f"--osm-files={source}", f"--output-file={network}"]
    done = subprocess.run([*command, *options], env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not network.is_file():
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        raise InputError(f"netconvert cannot make a network of {source}: {one_line(' '.join(said) or done.stderr)}")


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """A folder beside `out` that becomes it when all went well."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is there already and not empty: name another folder with -o")
    out.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        yield folder
        if out.exists():
            out.rmdir()
        folder.chmod(0o755)
        folder.rename(out)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
