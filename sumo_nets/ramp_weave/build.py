"""Builds the ramp_weave scenario: `python build.py` writes every other file of this folder.

Along the road: a run-in of 700 m, then 2.4 km with sites, and a run-out of 300 m. The part with sites has an on-ramp
whose lane ends after 250 m (merging), a bend, and, 800 m on, an on-ramp and an off-ramp joined by a lane of 400 m
(weaving). Three lanes, four beside the ramps.
"""

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.demand import flow, flows_by_lane
from isac_cosim.sumo_nets.plain import MOTORWAY_OPTIONS, Carriageway, Plain, PlainRoad, write_scenario

ROAD = PlainRoad(bend_m=700.0, radius_m=700.0, angle=float(np.radians(35.0)))
CARRIAGEWAY = Carriageway(
    ROAD,
    speed=27.78,
    lanes=3,
    pieces=(
        ("runin", -700.0, 0.0, 3),
        ("before", 0.0, 300.0, 3),
        ("merge", 300.0, 550.0, 4),
        ("between", 550.0, ROAD.bend_m, 3),
        ("bend", ROAD.bend_m, ROAD.bend_end_m, 3),
        ("on", ROAD.bend_end_m, 1350.0, 3),
        ("weave", 1350.0, 1750.0, 4),
        ("after", 1750.0, 2700.0, 3),
    ),
)


def network() -> Plain:
    """Return the roads."""
    plain = CARRIAGEWAY.network()
    CARRIAGEWAY.add_on_ramp(plain, "onramp1", "merge", 19.44)
    CARRIAGEWAY.add_on_ramp(plain, "onramp2", "weave", 19.44)
    CARRIAGEWAY.add_off_ramp(plain, "offramp", "weave", 19.44)
    return plain


def demand() -> list[str]:
    """Return the routes and flows, as lines of XML."""
    start = "runin before merge between bend on weave"
    return [
        f'<route id="through" edges="{start} after"/>',
        f'<route id="off" edges="{start} offramp"/>',
        '<route id="on1" edges="onramp1 merge between bend on weave after"/>',
        '<route id="on1off" edges="onramp1 merge between bend on weave offramp"/>',
        '<route id="on2" edges="onramp2 weave after"/>',
        *flows_by_lane("car_through", "through", 1600, range(CARRIAGEWAY.lanes)),
        *flows_by_lane("car_off", "off", 400, range(CARRIAGEWAY.lanes)),
        flow("car_on1", "cars", "on1", 300, depart_speed="13"),
        flow("car_on1off", "cars", "on1off", 60, depart_speed="13"),
        flow("car_on2", "cars", "on2", 400, depart_speed="13"),
        flow("truck_through", "trucks", "through", 200, lane=0),
        flow("truck_on2", "trucks", "on2", 40, depart_speed="13"),
    ]


if __name__ == "__main__":
    write_scenario(
        Path(__file__).parent, network(), demand(), CARRIAGEWAY.covered, MOTORWAY_OPTIONS, lanes=CARRIAGEWAY.lanes
    )
