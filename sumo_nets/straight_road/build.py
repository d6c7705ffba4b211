"""Builds the straight_road scenario: `python build.py` writes every other file of this folder.

A straight one-way road of 2.8 km with four lanes, and four sites around one point of it, 150 and 190 m up and down the
road and 60 m to either side, staggered so that they are no rectangle. Each site faces that point.
"""

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.demand import flow, flows_by_lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.scenarios.site_placement import sites_file
from isac_cosim.isacsim.scenarios.xml_files import write_lines
from isac_cosim.sumo_nets.plain import MOTORWAY_OPTIONS, Carriageway, PlainRoad, write_scenario

START_M, END_M = -800.0, 2000.0
"""The ends of the road, m; the sites stand around 0."""
ROAD = PlainRoad(bend_m=END_M, radius_m=1000.0, angle=0.0)
CARRIAGEWAY = Carriageway(ROAD, speed=36.11, lanes=4, pieces=(("road", START_M, END_M, 4),))
ALONG_M, STAGGER_M, ASIDE_M, HEIGHT_M = 170.0, 20.0, 60.0, 15.0


def sites() -> list[Site]:
    """Return the four sites, which face the point in their middle."""
    corners = [
        (along + np.sign(aside) * STAGGER_M, aside) for along in (-ALONG_M, ALONG_M) for aside in (-ASIDE_M, ASIDE_M)
    ]
    return [
        Site(f"site{k}", x, y, HEIGHT_M, round(float(np.degrees(np.arctan2(-x, -y))) % 360.0, 1))
        for k, (x, y) in enumerate(corners)
    ]


def demand() -> list[str]:
    """Return the route and the flows, as lines of XML."""
    return [
        '<route id="through" edges="road"/>',
        *flows_by_lane("car", "through", 2400, range(CARRIAGEWAY.lanes)),
        flow("truck", "trucks", "through", 200, lane=0),
    ]


if __name__ == "__main__":
    folder = Path(__file__).parent
    write_scenario(folder, CARRIAGEWAY.network(), demand(), {"road"}, MOTORWAY_OPTIONS, lanes=CARRIAGEWAY.lanes)
    write_lines(folder / "sites.add.xml", sites_file(sites()))
