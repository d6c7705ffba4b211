"""Builds the motorway scenario: `python build.py` in this folder writes every other file of it.

Geometry (m, x to the east): a run-in of 900 m, then 3 km that the sites cover: straight, on-ramp, a left-hand curve of
900 m radius, off-ramp, straight, and a run-out of 300 m. Four lanes of 3.6 m. Curves are drawn every 4 m, so that a
vertex turns a vehicle by a quarter of a degree and no more.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import sumo

from isacsim.demand import drivers, flow
from isacsim.scenario import read_network
from isacsim.site_placement import PlacementSettings, place, sites_file

HERE = Path(__file__).parent
LANE_M = 3.6
RUN_IN_M, COVERED_M, RUN_OUT_M = 900.0, 3000.0, 300.0
CURVE_START_M, CURVE_RADIUS_M, CURVE_ANGLE = 1100.0, 900.0, np.radians(50.0)
ON_RAMP_M, OFF_RAMP_M, RAMP_LANE_M = 500.0, 2300.0, 300.0


def centre_line(along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and headings (rad) of the road's middle at distances along it; 0 is where the sites begin."""
    arc = CURVE_RADIUS_M * CURVE_ANGLE
    turned = np.clip((along - CURVE_START_M) / CURVE_RADIUS_M, 0.0, CURVE_ANGLE)
    straight = np.minimum(along, CURVE_START_M)
    beyond = np.maximum(along - CURVE_START_M - arc, 0.0)
    x = straight + CURVE_RADIUS_M * np.sin(turned) + beyond * np.cos(turned)
    y = CURVE_RADIUS_M * (1.0 - np.cos(turned)) + beyond * np.sin(turned)
    return np.stack([x, y], axis=1), turned


def beside(along: np.ndarray, left_m: float | np.ndarray) -> np.ndarray:
    """Points at an offset from the centre line, left positive."""
    points, heading = centre_line(along)
    return points + np.stack([-np.sin(heading), np.cos(heading)], axis=1) * np.reshape(left_m, (-1, 1))


def shape(points: np.ndarray) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)


def pieces() -> list[tuple[str, float, float, int]]:
    """(edge, from, to, lanes) of the main carriageway; the ramps' lanes run beside it as a fifth."""
    end = COVERED_M + RUN_OUT_M
    return [
        ("runin", -RUN_IN_M, 0.0, 4),
        ("west", 0.0, ON_RAMP_M, 4),
        ("merge", ON_RAMP_M, ON_RAMP_M + RAMP_LANE_M, 5),
        ("curve", ON_RAMP_M + RAMP_LANE_M, OFF_RAMP_M - RAMP_LANE_M, 4),
        ("diverge", OFF_RAMP_M - RAMP_LANE_M, OFF_RAMP_M, 5),
        ("east", OFF_RAMP_M, end, 4),
    ]


def write_plain() -> None:
    """Nodes, edges and connections for netconvert. An edge's shape is the left side of its lanes (spreadType right)."""
    left = 2.0 * LANE_M
    ramp_y = -2.5 * LANE_M
    nodes, edges, connections = [], [], []
    for k, (name, start, end, lanes) in enumerate(pieces()):
        along = np.linspace(start, end, max(2, int((end - start) / 4.0) + 1))
        points = beside(along, left)
        nodes.append((f"n{k}", points[0]))
        if k == len(pieces()) - 1:
            nodes.append((f"n{k + 1}", points[-1]))
        edges.append(
            f'<edge id="{name}" from="n{k}" to="n{k + 1}" numLanes="{lanes}" speed="36.11" width="{LANE_M}" '
            f'spreadType="right" priority="10" shape="{shape(points)}"/>'
        )
    for name, at, sign in (("onramp", ON_RAMP_M, -1.0), ("offramp", OFF_RAMP_M, 1.0)):
        away = np.linspace(0.0, 260.0, 66)
        offset = ramp_y + LANE_M / 2 - 0.5 * away**2 / 1200.0
        points = beside(at + sign * away, offset)
        node = "n2" if name == "onramp" else "n5"
        nodes.append((name, points[-1]))
        ends = (name, node) if name == "onramp" else (node, name)
        ordered = points[::-1] if name == "onramp" else points
        edges.append(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="1" speed="22.22" width="{LANE_M}" '
            f'spreadType="right" priority="5" shape="{shape(ordered)}"/>'
        )
    def link(source: str, target: str, pairs: list[tuple[int, int]]) -> None:
        connections.extend(
            f'<connection from="{source}" to="{target}" fromLane="{a}" toLane="{b}"/>' for a, b in pairs
        )
    four = [(k, k) for k in range(4)]
    link("runin", "west", four)
    link("west", "merge", [(k, k + 1) for k in range(4)])
    link("onramp", "merge", [(0, 0)])
    link("merge", "curve", [(k + 1, k) for k in range(4)])
    link("curve", "diverge", [(k, k + 1) for k in range(4)])
    link("diverge", "east", [(k + 1, k) for k in range(4)])
    link("diverge", "offramp", [(0, 0)])
    listed = "".join(f'  <node id="{n}" x="{p[0]:.3f}" y="{p[1]:.3f}"/>\n' for n, p in nodes)
    (HERE / "motorway.nod.xml").write_text(f"<nodes>\n{listed}</nodes>\n")
    (HERE / "motorway.edg.xml").write_text("<edges>\n  " + "\n  ".join(edges) + "\n</edges>\n")
    (HERE / "motorway.con.xml").write_text("<connections>\n  " + "\n  ".join(connections) + "\n</connections>\n")


def write_demand() -> None:
    """Drivers, and flows along the carriageway and the ramps."""
    main = "runin west merge curve diverge"
    routes = {
        "through": f"{main} east",
        "off": f"{main} offramp",
        "on": "onramp merge curve diverge east",
    }
    lines = drivers(np.random.default_rng(20250101))
    lines += [f'<route id="{name}" edges="{edges}"/>' for name, edges in routes.items()]
    lines += [
        flow("car_through", "cars", "through", 2400),
        flow("car_off", "cars", "off", 240),
        flow("car_on", "cars", "on", 300, depart_speed="15"),
        flow("truck_through", "trucks", "through", 300),
        flow("truck_on", "trucks", "on", 40, depart_speed="15"),
    ]
    (HERE / "motorway.rou.xml").write_text("<routes>\n  " + "\n  ".join(lines) + "\n</routes>\n")


def write_sites() -> None:
    """Poles along everything but the run-in and the ramps."""
    lanes, _ = read_network(HERE / "motorway.net.xml")
    sites = place(lanes, {name for name, *_ in pieces()} - {"runin"}, PlacementSettings())
    (HERE / "sites.add.xml").write_text(sites_file(sites))


def main() -> None:
    write_plain()
    write_demand()
    inputs = ["--node-files=motorway.nod.xml", "--edge-files=motorway.edg.xml", "--connection-files=motorway.con.xml"]
    subprocess.run(
        [Path(sumo.SUMO_HOME) / "bin" / "netconvert", *inputs, "--output-file=motorway.net.xml", "--no-turnarounds",
         "--offset.disable-normalization", "--geometry.min-dist=0", "--default.junctions.radius=1", "--precision=3"],
        cwd=HERE, check=True, stdout=sys.stderr,
    )
    network = HERE / "motorway.net.xml"
    # netconvert's header holds the date: without it the same inputs give the same file.
    network.write_text(re.sub(r"<!-- generated on.*?-->\s*", "", network.read_text(), flags=re.DOTALL))
    write_sites()
    (HERE / "motorway.sumocfg").write_text(
        """<configuration>
  <input>
    <net-file value="motorway.net.xml"/>
    <route-files value="motorway.rou.xml"/>
    <additional-files value="sites.add.xml"/>
  </input>
</configuration>
"""
    )


if __name__ == "__main__":
    main()
