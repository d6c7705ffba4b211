"""Builds the urban scenario: `python build.py` writes every other file of this folder.

A signalled arterial of 1.8 km from west to east: two lanes per direction, 50 km/h, four intersections 360 m apart, each
with a cross street of one lane per direction. Vehicles may turn both ways from the arterial.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.demand import flow
from isac_cosim.sumo_nets.plain import Plain, write_scenario

LIMIT = 13.89
BLOCK_M, CROSSINGS, SIDE_M = 360.0, 4, 200.0


def both_ways(plain: Plain, a: str, b: str, ends: tuple[np.ndarray, np.ndarray], lanes: int, priority: int) -> None:
    """Add two edges, one for each driving direction, that share their middle line. ends: x, y of both, m."""
    line = np.linspace(*ends, 2)
    plain.edge(f"{a}_{b}", (a, b), lanes, LIMIT, line, priority)
    plain.edge(f"{b}_{a}", (b, a), lanes, LIMIT, line[::-1], priority)


def network() -> Plain:
    """Return the roads."""
    plain = Plain()
    at = {f"x{k}": np.array([BLOCK_M * k, 0.0]) for k in range(1, CROSSINGS + 1)}
    for name, point in at.items():
        plain.node(name, point, "traffic_light")
    ends = {"w": np.array([0.0, 0.0]), **at, "e": np.array([BLOCK_M * (CROSSINGS + 1), 0.0])}
    names = list(ends)
    for a, b in pairwise(names):
        both_ways(plain, a, b, (ends[a], ends[b]), lanes=2, priority=10)
    side = np.array([0.0, SIDE_M])
    for k, (name, point) in enumerate(at.items(), 1):
        both_ways(plain, f"n{k}", name, (point + side, point), lanes=1, priority=5)
        both_ways(plain, f"s{k}", name, (point - side, point), lanes=1, priority=5)
    return plain


def route(name: str, *stops: str) -> str:
    """Return a route over nodes, as a line of XML."""
    edges = " ".join(f"{a}_{b}" for a, b in pairwise(stops))
    return f'<route id="{name}" edges="{edges}"/>'


def demand() -> list[str]:
    """Return the routes and flows, as lines of XML."""
    along = ["w", *(f"x{k}" for k in range(1, CROSSINGS + 1)), "e"]
    lines = [route("east", *along), route("west", *along[::-1])]
    for name in ("east", "west"):
        lines += [flow(f"car_{name}", "cars", name, 700), flow(f"truck_{name}", "trucks", name, 50)]
    for k in range(1, CROSSINGS + 1):
        routes = {
            f"down{k}": (f"n{k}", f"x{k}", f"s{k}"),
            f"up{k}": (f"s{k}", f"x{k}", f"n{k}"),
            f"in{k}": (f"n{k}", *along[k:]),
            f"out{k}": (*along[: k + 1], f"s{k}"),
            f"back{k}": (*along[:k:-1], f"x{k}", f"n{k}"),
        }
        for name, stops in routes.items():
            lines += [route(name, *stops), flow(f"car_{name}", "cars", name, 60)]
    return lines


if __name__ == "__main__":
    arterial = {f"{a}_{b}" for a in ("w", "x1", "x2", "x3", "x4", "e") for b in ("w", "x1", "x2", "x3", "x4", "e")}
    write_scenario(Path(__file__).parent, network(), demand(), arterial, ["--tls.default-type=static"])
