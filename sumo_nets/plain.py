"""Shared by the build scripts of the bundled scenarios: plain XML, netconvert, and the files of a scenario folder."""

import re
import subprocess
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import sumo

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.demand import by_lane, drivers
from isac_cosim.isacsim.scenarios.scenario import read_network
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings, place, sites_file
from isac_cosim.isacsim.scenarios.sumo_files import is_lefthand
from isac_cosim.isacsim.scenarios.xml_files import write_lines

LANE_M = 3.6
MOTORWAY_OPTIONS = ("--default.junctions.radius=1",)
"""Options of netconvert for carriageways: edges that meet head-on need no more room than this."""


@dataclass
class Plain:
    """A network under construction, in netconvert's plain form; coordinates in m."""

    nodes: dict[str, str] = field(default_factory=dict)
    edges: list[str] = field(default_factory=list)
    connections: list[str] = field(default_factory=list)

    def node(self, name: str, point: Sequence[float] | Array, kind: str = "priority") -> None:
        """Add a node, unless there is one of that name. point: x, y, m. kind: SUMO's type of junction."""
        self.nodes.setdefault(name, f'<node id="{name}" x="{point[0]:.3f}" y="{point[1]:.3f}" type="{kind}"/>')

    def edge(
        self, name: str, ends: tuple[str, str], lanes: int, speed: float, left_border: Array, priority: int = 10
    ) -> None:
        """Add an edge whose lanes lie to the right of a line, m, (n, 2). ends: its nodes. speed: limit, m/s."""
        shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in left_border)
        self.node(ends[0], left_border[0])
        self.node(ends[1], left_border[-1])
        self.edges.append(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{lanes}" speed="{speed}" width="{LANE_M}" '
            f'spreadType="right" priority="{priority}" shape="{shape}"/>'
        )

    def link(self, source: str, target: str, lanes: range, shift: int = 0) -> None:
        """Connect lanes of an edge to the lanes of the next edge whose index is `shift` higher."""
        self.connections += [
            f'<connection from="{source}" to="{target}" fromLane="{k}" toLane="{k + shift}"/>' for k in lanes
        ]


@dataclass(frozen=True)
class PlainRoad:
    """The middle line of a straight road with one bend to the left.

    bend_m: where the bend begins, m along the road. radius_m, angle: of the bend, m and rad.

    Let edges begin and end where the bend does. SUMO gives all lanes of an edge the same length, and a vehicle that
    changes lanes keeps its distance along the edge: on an edge that is partly bent, it would jump by half a metre.
    """

    bend_m: float
    radius_m: float
    angle: float

    @property
    def bend_end_m(self) -> float:
        """Where the bend ends, m along the road."""
        return self.bend_m + self.radius_m * self.angle

    def beside(self, along: Array, left_m: float | Array) -> Array:
        """Return points beside the road, m, (n, 2). along: m along the road, (n,). left_m: offset, left positive, m."""
        turned = np.clip((along - self.bend_m) / self.radius_m, 0.0, self.angle)
        beyond = np.maximum(along - self.bend_end_m, 0.0)
        x = np.minimum(along, self.bend_m) + self.radius_m * np.sin(turned) + beyond * np.cos(turned)
        y = self.radius_m * (1.0 - np.cos(turned)) + beyond * np.sin(turned)
        across = np.stack([-np.sin(turned), np.cos(turned)], axis=1) * np.reshape(left_m, (-1, 1))
        return np.asarray(np.stack([x, y], axis=1) + across)

    def piece(self, start: float, end: float, left_m: float) -> Array:
        """Return the line beside the road from start to end, m, (n, 2), with a vertex every 4 m where it is bent.

        Straight lines have no vertex between their ends, because SUMO walks through a lane's vertices one by one.
        """
        straight = end <= self.bend_m or start >= self.bend_end_m
        return self.beside(np.linspace(start, end, 2 if straight else int((end - start) / 4.0) + 1), left_m)

    def ramp(self, at: float, left_m: float, towards: float) -> Array:
        """Return the line of a 260 m ramp that leaves (towards +1) or joins (-1) the road at an offset, m, (n, 2)."""
        away = np.linspace(0.0, 260.0, 66)
        points = self.beside(at + towards * away, left_m - 0.5 * away**2 / 1200.0)
        return points if towards > 0 else points[::-1]


@dataclass(frozen=True)
class Carriageway:
    """A motorway carriageway along a road, made of edges end to end.

    speed: limit, m/s. lanes: of its main part, half of them on either side of the road's middle.
    pieces: name, start, end (m along the road) and number of lanes of each edge. Additional lanes lie on the right.
    Each edge must be either straight or bent, see `PlainRoad`.
    """

    road: PlainRoad
    speed: float
    lanes: int
    pieces: tuple[tuple[str, float, float, int], ...]

    @property
    def covered(self) -> set[str]:
        """The edges that get sites: all but the run-in, which is the first, and the ramps."""
        return {name for name, *_ in self.pieces[1:]}

    def network(self) -> Plain:
        """Return the edges, with each lane linked to the lane of the next edge that continues it."""
        plain = Plain()
        for k, (name, start, end, lanes) in enumerate(self.pieces):
            line = self.road.piece(start, end, self._left_m)
            plain.edge(name, (f"n{k}", f"n{k + 1}"), lanes, self.speed, line)
        for (before, *_, lanes), (after, *_, next_lanes) in pairwise(self.pieces):
            plain.link(before, after, range(max(0, lanes - next_lanes), lanes), next_lanes - lanes)
        return plain

    def add_on_ramp(self, plain: Plain, name: str, edge: str, speed: float) -> None:
        """Add a ramp that becomes the rightmost lane of an edge."""
        k = self._number(edge)
        line = self.road.ramp(self.pieces[k][1], -self._left_m, -1.0)
        plain.edge(name, (name, f"n{k}"), 1, speed, line, priority=5)
        plain.link(name, edge, range(1))

    def add_off_ramp(self, plain: Plain, name: str, edge: str, speed: float) -> None:
        """Add a ramp that the rightmost lane of an edge becomes."""
        k = self._number(edge)
        line = self.road.ramp(self.pieces[k][2], -self._left_m, +1.0)
        plain.edge(name, (f"n{k + 1}", name), 1, speed, line, priority=5)
        plain.link(edge, name, range(1))

    @property
    def _left_m(self) -> float:
        return 0.5 * self.lanes * LANE_M

    def _number(self, edge: str) -> int:
        return [name for name, *_ in self.pieces].index(edge)


def write_scenario(
    folder: Path,
    plain: Plain,
    demand: Sequence[str],
    covered: Collection[str],
    options: Sequence[str] = (),
    stops: Sequence[str] = (),
    lanes: int = 0,
) -> None:
    """Write every file of a scenario folder: plain network, network, demand, stops, sites, configuration.

    demand: lines of routes and flows. covered: edges that get sites. options: more options of netconvert. stops: lines
    of bus stops; without any, there is no file of them. lanes: of the road on which cars of `flows_by_lane` enter.
    """
    name = folder.name
    for kind, lines in (("nod", plain.nodes.values()), ("edg", plain.edges), ("con", plain.connections)):
        tag = {"nod": "nodes", "edg": "edges", "con": "connections"}[kind]
        write_lines(folder / f"{name}.{kind}.xml", f"<{tag}>\n  " + "\n  ".join(lines) + f"\n</{tag}>\n")
    inputs = [f"--{long}-files={name}.{long[:3] if long != 'edge' else 'edg'}.xml" for long in ("node", "edge")]
    subprocess.run(
        [Path(sumo.SUMO_HOME) / "bin" / "netconvert", *inputs, f"--connection-files={name}.con.xml",
         f"--output-file={name}.net.xml", "--no-turnarounds", "--offset.disable-normalization",
         "--geometry.min-dist=0", "--precision=3", *options],
        cwd=folder, check=True, stdout=sys.stderr,
    )  # fmt: skip
    network = folder / f"{name}.net.xml"
    # netconvert writes the date into the header. Without it, equal inputs give equal files.
    text = network.read_text(encoding="utf-8")
    write_lines(network, re.sub(r"<!-- generated on.*?-->\s*", "", text, flags=re.DOTALL))
    types = drivers(np.random.default_rng(20250101))
    routes = [*types, *(by_lane(types, lanes) if lanes else ()), *demand]
    write_lines(folder / f"{name}.rou.xml", "<routes>\n  " + "\n  ".join(routes) + "\n</routes>\n")
    sites = place(read_network(network).lanes, covered, PlacementSettings(), is_lefthand(network))
    write_lines(folder / "sites.add.xml", sites_file(sites))
    additional = "sites.add.xml"
    if stops:
        write_lines(folder / "stops.add.xml", "<additional>\n  " + "\n  ".join(stops) + "\n</additional>\n")
        additional = f"stops.add.xml,{additional}"
    write_lines(
        folder / f"{name}.sumocfg",
        f"""<configuration>
  <input>
    <net-file value="{name}.net.xml"/>
    <route-files value="{name}.rou.xml"/>
    <additional-files value="{additional}"/>
  </input>
</configuration>
""",
    )
