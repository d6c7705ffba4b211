"""What the bundled scenarios' build scripts share: plain XML, netconvert, and the files of a scenario folder."""

import re
import subprocess
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import sumo

from isacsim.arrays import Array
from isacsim.scenarios.demand import drivers
from isacsim.scenarios.scenario import read_network
from isacsim.scenarios.site_placement import PlacementSettings, place, sites_file

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
        self.nodes.setdefault(name, f'<node id="{name}" x="{point[0]:.3f}" y="{point[1]:.3f}" type="{kind}"/>')

    def edge(
        self, name: str, ends: tuple[str, str], lanes: int, speed: float, left_border: Array, priority: int = 10
    ) -> None:
        """An edge whose lanes lie to the right of a line, shape (n, 2)."""
        shape = " ".join(f"{x:.3f},{y:.3f}" for x, y in left_border)
        self.node(ends[0], left_border[0])
        self.node(ends[1], left_border[-1])
        self.edges.append(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{lanes}" speed="{speed}" width="{LANE_M}" '
            f'spreadType="right" priority="{priority}" shape="{shape}"/>'
        )

    def link(self, source: str, target: str, lanes: range, shift: int = 0) -> None:
        """Connect lanes of an edge to the next edge's, `shift` numbers higher."""
        self.connections += [
            f'<connection from="{source}" to="{target}" fromLane="{k}" toLane="{k + shift}"/>' for k in lanes
        ]


@dataclass(frozen=True)
class Road:
    """A straight road with one bend to the left: points beside its middle, by distance along it.

    bend_m: where the bend begins, m; radius_m, angle (rad): of the bend.

    Begin and end an edge where the bend does. SUMO gives all lanes of an edge one length, and keeps a vehicle's
    distance along the edge when it changes lanes: where an edge is partly bent, that is a jump of half a metre.
    """

    bend_m: float
    radius_m: float
    angle: float

    @property
    def bend_end_m(self) -> float:
        """Where the bend ends, m along the road."""
        return self.bend_m + self.radius_m * self.angle

    def beside(self, along: Array, left_m: float | Array) -> Array:
        """Points at an offset from the middle, left positive, shape (n, 2)."""
        turned = np.clip((along - self.bend_m) / self.radius_m, 0.0, self.angle)
        beyond = np.maximum(along - self.bend_end_m, 0.0)
        x = np.minimum(along, self.bend_m) + self.radius_m * np.sin(turned) + beyond * np.cos(turned)
        y = self.radius_m * (1.0 - np.cos(turned)) + beyond * np.sin(turned)
        across = np.stack([-np.sin(turned), np.cos(turned)], axis=1) * np.reshape(left_m, (-1, 1))
        return np.asarray(np.stack([x, y], axis=1) + across)

    def piece(self, start: float, end: float, left_m: float) -> Array:
        """The line beside the road from start to end, with a vertex every 4 m where it is bent.

        A straight line has none between its ends: SUMO looks through a lane's vertices one by one.
        """
        straight = end <= self.bend_m or start >= self.bend_end_m
        return self.beside(np.linspace(start, end, 2 if straight else int((end - start) / 4.0) + 1), left_m)

    def ramp(self, at: float, left_m: float, towards: float) -> Array:
        """A lane that leaves (towards +1) or, driven the other way, joins (-1) the line at an offset, 260 m long."""
        away = np.linspace(0.0, 260.0, 66)
        points = self.beside(at + towards * away, left_m - 0.5 * away**2 / 1200.0)
        return points if towards > 0 else points[::-1]


@dataclass(frozen=True)
class Carriageway:
    """A motorway carriageway along a road, of edges end to end.

    lanes: of its main part, half of them on either side of the road's middle. pieces: edge, from, to (m along the
    road), lanes; what an edge has more than `lanes` lies on the right. An edge is straight or bent throughout: see
    `Road`.
    """

    road: Road
    speed: float
    lanes: int
    pieces: tuple[tuple[str, float, float, int], ...]

    @property
    def covered(self) -> set[str]:
        """The edges that get sites: all but the first, the run-in, and the ramps."""
        return {name for name, *_ in self.pieces[1:]}

    def network(self) -> Plain:
        """The edges, each lane linked to the next edge's beside it."""
        plain = Plain()
        for k, (name, start, end, lanes) in enumerate(self.pieces):
            line = self.road.piece(start, end, self._left_m)
            plain.edge(name, (f"n{k}", f"n{k + 1}"), lanes, self.speed, line)
        for (before, *_, has), (after, *_, gets) in pairwise(self.pieces):
            plain.link(before, after, range(max(0, has - gets), has), gets - has)
        return plain

    def add_on_ramp(self, plain: Plain, name: str, edge: str, speed: float) -> None:
        """A ramp that becomes the rightmost lane of an edge."""
        k = self._number(edge)
        line = self.road.ramp(self.pieces[k][1], -self._left_m, -1.0)
        plain.edge(name, (name, f"n{k}"), 1, speed, line, priority=5)
        plain.link(name, edge, range(1))

    def add_off_ramp(self, plain: Plain, name: str, edge: str, speed: float) -> None:
        """A ramp that the rightmost lane of an edge becomes."""
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
    folder: Path, plain: Plain, demand: Sequence[str], covered: Collection[str], options: Sequence[str] = ()
) -> None:
    """Write every file of a scenario folder: plain network, network, demand, sites, configuration.

    demand: lines of routes and flows. covered: edges that get sites. options: more of netconvert's.
    """
    name = folder.name
    for kind, lines in (("nod", plain.nodes.values()), ("edg", plain.edges), ("con", plain.connections)):
        tag = {"nod": "nodes", "edg": "edges", "con": "connections"}[kind]
        (folder / f"{name}.{kind}.xml").write_text(f"<{tag}>\n  " + "\n  ".join(lines) + f"\n</{tag}>\n")
    inputs = [f"--{long}-files={name}.{long[:3] if long != 'edge' else 'edg'}.xml" for long in ("node", "edge")]
    subprocess.run(
        [Path(sumo.SUMO_HOME) / "bin" / "netconvert", *inputs, f"--connection-files={name}.con.xml",
         f"--output-file={name}.net.xml", "--no-turnarounds", "--offset.disable-normalization",
         "--geometry.min-dist=0", "--precision=3", *options],
        cwd=folder, check=True, stdout=sys.stderr,
    )  # fmt: skip
    network = folder / f"{name}.net.xml"
    # netconvert's header holds the date: without it the same inputs give the same file.
    network.write_text(re.sub(r"<!-- generated on.*?-->\s*", "", network.read_text(), flags=re.DOTALL))
    routes = [*drivers(np.random.default_rng(20250101)), *demand]
    (folder / f"{name}.rou.xml").write_text("<routes>\n  " + "\n  ".join(routes) + "\n</routes>\n")
    lanes, _ = read_network(network)
    (folder / "sites.add.xml").write_text(sites_file(place(lanes, covered, PlacementSettings())))
    (folder / f"{name}.sumocfg").write_text(
        f"""<configuration>
  <input>
    <net-file value="{name}.net.xml"/>
    <route-files value="{name}.rou.xml"/>
    <additional-files value="sites.add.xml"/>
  </input>
</configuration>
"""
    )
