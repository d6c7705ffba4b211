"""Builds the motorway_sparse scenario: `python build.py` writes every other file of this folder.

The road and the demand are those of motorway; the poles stand every 500 m, on alternating sides.
"""

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings, panels, sites_file
from isac_cosim.isacsim.scenarios.xml_files import write_lines
from isac_cosim.sumo_nets.motorway.build import CARRIAGEWAY, ROAD
from isac_cosim.sumo_nets.plain import LANE_M

FIRST_M, SPACING_M, POLES = 150.0, 500.0, 7
CONFIGURATION = """<configuration>
  <input>
    <net-file value="../motorway/motorway.net.xml"/>
    <route-files value="../motorway/motorway.rou.xml"/>
    <additional-files value="sites.add.xml"/>
  </input>
</configuration>
"""


def sites() -> list[Site]:
    """Return the two panels of each pole, from west to east; the first pole stands on the right."""
    settings = PlacementSettings(spacing_m=SPACING_M)
    result = []
    for k in range(POLES):
        along, side = FIRST_M + k * SPACING_M, -1.0 if k % 2 == 0 else 1.0
        lanes = next(lanes for _, start, end, lanes in CARRIAGEWAY.pieces if start <= along < end)
        # Lanes beside the ramps are added on the right.
        on_this_side = CARRIAGEWAY.lanes / 2 + (lanes - CARRIAGEWAY.lanes if side < 0 else 0)
        pole = ROAD.beside(np.array([along]), side * (on_this_side * LANE_M + settings.set_back_m))[0]
        before, after = ROAD.beside(along + np.array([-0.5, 0.5]), 0.0)
        heading = float(np.arctan2(*(after - before)[::-1]))
        result += panels(f"pole{k}", pole, heading, side, settings)
    return result


if __name__ == "__main__":
    folder = Path(__file__).parent
    write_lines(folder / f"{folder.name}.sumocfg", CONFIGURATION)
    write_lines(folder / "sites.add.xml", sites_file(sites()))
