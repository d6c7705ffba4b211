"""Builds the city scenario: `python build.py` writes every other file of this folder.

A road network as maps give it, small: centre lines with a corner every 25 m, left-hand traffic, signals, and vehicles
parked beside the road. An arterial of 1.6 km from west to east with three lanes per direction and 60 km/h crosses two
streets of one lane per direction and 30 km/h. Corners of the arterial turn by 3 degrees in the median. Each arm of a
street has one sharp corner, of 20 to 45 degrees. Buses stop in bays, and cars stand parked beside the arterial.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.demand import flow
from isac_cosim.sumo_nets.plain import Plain, write_scenario

SEED = 20251122
ARTERIAL_MPS, STREET_MPS = 16.67, 8.33
BLOCKS_M = (450.0, 700.0, 450.0)
STREET_M, SPACING_M, MEDIAN_DEG = 200.0, 25.0, 3.0
SHARP_DEG = {"n1": 20.0, "s1": 30.0, "n2": -25.0, "s2": 45.0}
"""The sharp corner of each arm of a street, named after its outer end; left positive."""
ALONG = ("w", "x1", "x2", "e")
BUSES_PER_HOUR, BUS_STAY_S = 120.0, 25
PARKED = {"w_x1": 120.0, "x2_e": 200.0, "e_x2": 150.0}
"""Where a car stands parked beside the outermost lane: edge, and metres from its start."""


def kinked(start: Array, heading: float, length_m: float, rng: np.random.Generator, sharp_deg: float = 0.0) -> Array:
    """Return a line with a corner every `SPACING_M`, m, (n, 2).

    start: x, y, m. heading: of the first side, rad. sharp_deg: of an additional corner in the middle.
    The corners turn back towards the first direction more often than away from it.
    """
    sides = round(length_m / SPACING_M)
    headings = [heading]
    for k in range(1, sides):
        turn = np.radians(MEDIAN_DEG) * float(np.clip(rng.lognormal(0.0, 0.5), 0.2, 2.5))
        away = float(np.sign(headings[-1] - heading)) or 1.0
        headings.append(headings[-1] + turn * (away if rng.random() < 0.2 else -away))
        if sharp_deg and k == sides // 2:
            headings[-1] += np.radians(sharp_deg)
            heading += np.radians(sharp_deg)
    steps = SPACING_M * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.concatenate([[start], start + np.cumsum(steps, axis=0)])


def both_ways(plain: Plain, a: str, b: str, line: Array, lanes: int, speed: float, priority: int) -> None:
    """Add two edges, one for each driving direction, that share their middle line, m, (n, 2)."""
    plain.edge(f"{a}_{b}", (a, b), lanes, speed, line, priority)
    plain.edge(f"{b}_{a}", (b, a), lanes, speed, line[::-1], priority)


def network() -> Plain:
    """Return the roads. With netconvert's `--lefthand`, lanes lie to the left of the line of their edge."""
    plain, rng = Plain(), np.random.default_rng(SEED)
    lines, start = [], np.zeros(2)
    for length_m in BLOCKS_M:
        lines.append(kinked(start, 0.0, length_m, rng))
        start = lines[-1][-1]
    for name, line in zip(("x1", "x2"), lines[1:], strict=True):
        plain.node(name, line[0], "traffic_light")
    for (a, b), line in zip(pairwise(ALONG), lines, strict=True):
        both_ways(plain, a, b, line, 3, ARTERIAL_MPS, priority=10)
    for name, line in zip(("x1", "x2"), lines[1:], strict=True):
        for side, heading in (("n", np.pi / 2.0), ("s", -np.pi / 2.0)):
            end = side + name[1:]
            arm = kinked(line[0], heading, STREET_M, rng, SHARP_DEG[end])
            both_ways(plain, name, end, arm, 1, STREET_MPS, priority=5)
    return plain


def route(name: str, *stops: str) -> str:
    """Return a route over nodes, as a line of XML."""
    edges = " ".join(f"{a}_{b}" for a, b in pairwise(stops))
    return f'<route id="{name}" edges="{edges}"/>'


def demand() -> list[str]:
    """Return the routes, flows and parked vehicles, as lines of XML."""
    lines = [
        '<vType id="bus" vClass="bus" carFollowModel="IDM" speedDev="0" latAlignment="center" length="12.0" '
        'width="2.50" minGap="3.0" accel="1.2" decel="3.5" emergencyDecel="7.0" tau="1.5" maxSpeed="20" '
        'speedFactor="0.9" maxSpeedLat="0.8" lcAccelLat="0.6" lcKeepRight="5.0"/>',
        route("east", *ALONG),
        route("west", *ALONG[::-1]),
    ]
    for name in ("east", "west"):
        lines += [flow(f"car_{name}", "cars", name, 900), flow(f"truck_{name}", "trucks", name, 60)]
        bus = flow(f"bus_{name}", "bus", name, BUSES_PER_HOUR).removesuffix("/>")
        lines.append(f'{bus}><stop busStop="stop_{name}" duration="{BUS_STAY_S}" parking="true"/></flow>')
    for k in ("1", "2"):
        onward, back = ALONG[ALONG.index(f"x{k}") :], ALONG[: ALONG.index(f"x{k}") + 1][::-1]
        routes = {
            f"down{k}": (f"n{k}", f"x{k}", f"s{k}"),
            f"up{k}": (f"s{k}", f"x{k}", f"n{k}"),
            f"in{k}": (f"n{k}", *onward),
            f"out{k}": (*ALONG[: ALONG.index(f"x{k}") + 1], f"s{k}"),
            f"home{k}": (f"s{k}", *back),
        }
        for name, stops in routes.items():
            lines += [route(name, *stops), flow(f"car_{name}", "cars", name, 70)]
    for number, (edge, at_m) in enumerate(PARKED.items()):
        lines.append(
            f'<vehicle id="parked_{number}" type="cars" depart="0" departLane="0" departPos="{at_m - 60.0}" '
            f'departSpeed="5"><route edges="{edge}"/><stop lane="{edge}_0" startPos="{at_m - 8.0}" endPos="{at_m}" '
            'duration="100000" parking="true"/></vehicle>'
        )
    return lines


def stops() -> list[str]:
    """Return the bus stops, as lines of XML."""
    return [
        f'<busStop id="stop_{name}" lane="{edge}_0" startPos="250" endPos="280"/>'
        for name, edge in (("east", "w_x1"), ("west", "e_x2"))
    ]


if __name__ == "__main__":
    arterial = {f"{a}_{b}" for pair in pairwise(ALONG) for a, b in (pair, pair[::-1])}
    write_scenario(
        Path(__file__).parent, network(), demand(), arterial, ["--lefthand", "--tls.default-type=static"], stops()
    )
