"""Builds the motorway scenario: `python build.py` writes every other file of this folder.

Along the road: a run-in of 900 m, then 3.3 km with sites (straight, on-ramp, left-hand curve of 900 m radius, off-ramp,
straight). Four lanes, five beside the ramps.
"""

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.demand import flow, flows_by_lane
from isac_cosim.sumo_nets.plain import MOTORWAY_OPTIONS, Carriageway, Plain, PlainRoad, write_scenario

ROAD = PlainRoad(bend_m=1100.0, radius_m=900.0, angle=float(np.radians(50.0)))
CARRIAGEWAY = Carriageway(
    ROAD,
    speed=36.11,
    lanes=4,
    pieces=(
        ("runin", -900.0, 0.0, 4),
        ("west", 0.0, 500.0, 4),
        ("merge", 500.0, 800.0, 5),
        ("approach", 800.0, ROAD.bend_m, 4),
        ("curve", ROAD.bend_m, ROAD.bend_end_m, 4),
        ("leave", ROAD.bend_end_m, 2000.0, 4),
        ("diverge", 2000.0, 2300.0, 5),
        ("east", 2300.0, 3300.0, 4),
    ),
)


def network() -> Plain:
    """Return the roads."""
    plain = CARRIAGEWAY.network()
    CARRIAGEWAY.add_on_ramp(plain, "onramp", "merge", 22.22)
    CARRIAGEWAY.add_off_ramp(plain, "offramp", "diverge", 22.22)
    return plain


def demand() -> list[str]:
    """Return the routes and flows, as lines of XML."""
    main = "runin west merge approach curve leave diverge"
    return [
        f'<route id="through" edges="{main} east"/>',
        f'<route id="off" edges="{main} offramp"/>',
        '<route id="on" edges="onramp merge approach curve leave diverge east"/>',
        *flows_by_lane("car_through", "through", 2400, range(CARRIAGEWAY.lanes)),
        *flows_by_lane("car_off", "off", 240, range(CARRIAGEWAY.lanes)),
        flow("car_on", "cars", "on", 300, depart_speed="15"),
        flow("truck_through", "trucks", "through", 300, lane=0),
        flow("truck_on", "trucks", "on", 40, depart_speed="15"),
    ]


if __name__ == "__main__":
    write_scenario(
        Path(__file__).parent, network(), demand(), CARRIAGEWAY.covered, MOTORWAY_OPTIONS, lanes=CARRIAGEWAY.lanes
    )
