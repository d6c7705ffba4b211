"""Builds the ramp_weave scenario: `python build.py` writes every other file of this folder.

Along the road (m): a run-in of 700 m, then 2.4 km that the sites cover: an on-ramp whose lane ends after 250 m
(merging), a bend, and 800 m on another on-ramp and an off-ramp joined by a lane of 400 m (weaving); and a run-out of
300 m. Three lanes; beside the ramps a fourth.
"""

from pathlib import Path

import numpy as np

from isacsim.demand import flow
from sumo_nets.plain import LANE_M, Plain, Road, write_scenario

LIMIT = 27.78
ROAD = Road(bend_m=700.0, radius_m=700.0, angle=float(np.radians(35.0)))
PIECES = (
    ("runin", -700.0, 0.0, 3),
    ("before", 0.0, 300.0, 3),
    ("merge", 300.0, 550.0, 4),
    ("between", 550.0, ROAD.bend_m, 3),
    ("bend", ROAD.bend_m, ROAD.bend_end_m, 3),
    ("on", ROAD.bend_end_m, 1350.0, 3),
    ("weave", 1350.0, 1750.0, 4),
    ("after", 1750.0, 2700.0, 3),
)
"""Edge, from, to (m along the road), lanes. An edge is straight or bent throughout: see `Road`."""


def network() -> Plain:
    plain = Plain()
    for k, (name, start, end, lanes) in enumerate(PIECES):
        plain.edge(name, (f"n{k}", f"n{k + 1}"), lanes, LIMIT, ROAD.piece(start, end, 1.5 * LANE_M))
    ramp_left = -1.5 * LANE_M
    plain.edge("onramp1", ("onramp1", "n2"), 1, 19.44, ROAD.ramp(300.0, ramp_left, -1.0), priority=5)
    plain.edge("onramp2", ("onramp2", "n6"), 1, 19.44, ROAD.ramp(1350.0, ramp_left, -1.0), priority=5)
    plain.edge("offramp", ("n7", "offramp"), 1, 19.44, ROAD.ramp(1750.0, ramp_left, +1.0), priority=5)
    plain.link("runin", "before", range(3))
    plain.link("before", "merge", range(3), +1)
    plain.link("onramp1", "merge", range(1))
    plain.link("merge", "between", range(1, 4), -1)
    plain.link("between", "bend", range(3))
    plain.link("bend", "on", range(3))
    plain.link("on", "weave", range(3), +1)
    plain.link("onramp2", "weave", range(1))
    plain.link("weave", "after", range(1, 4), -1)
    plain.link("weave", "offramp", range(1))
    return plain


def demand() -> list[str]:
    start = "runin before merge between bend on weave"
    return [
        f'<route id="through" edges="{start} after"/>',
        f'<route id="off" edges="{start} offramp"/>',
        '<route id="on1" edges="onramp1 merge between bend on weave after"/>',
        '<route id="on1off" edges="onramp1 merge between bend on weave offramp"/>',
        '<route id="on2" edges="onramp2 weave after"/>',
        flow("car_through", "cars", "through", 1600),
        flow("car_off", "cars", "off", 400),
        flow("car_on1", "cars", "on1", 300, depart_speed="13"),
        flow("car_on1off", "cars", "on1off", 60, depart_speed="13"),
        flow("car_on2", "cars", "on2", 400, depart_speed="13"),
        flow("truck_through", "trucks", "through", 200),
        flow("truck_on2", "trucks", "on2", 40, depart_speed="13"),
    ]


if __name__ == "__main__":
    covered = {name for name, *_ in PIECES} - {"runin"}
    write_scenario(Path(__file__).parent, network(), demand(), covered, ["--default.junctions.radius=1"])
