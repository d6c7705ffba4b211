"""Builds the straight_road_rectangle scenario: `python build.py` writes every other file of this folder.

The road and the demand are those of straight_road; the four sites stand at the corners of a rectangle.
"""

from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.scenarios.site_placement import sites_file
from isac_cosim.isacsim.scenarios.xml_files import write_lines

ALONG_M, ASIDE_M, HEIGHT_M = 170.0, 60.0, 15.0
CONFIGURATION = """<configuration>
  <input>
    <net-file value="../straight_road/straight_road.net.xml"/>
    <route-files value="../straight_road/straight_road.rou.xml"/>
    <additional-files value="sites.add.xml"/>
  </input>
</configuration>
"""


def sites() -> list[Site]:
    """Return the four sites, which face the point in their middle."""
    corners = [(x, y) for x in (-ALONG_M, ALONG_M) for y in (-ASIDE_M, ASIDE_M)]
    return [
        Site(f"site{k}", x, y, HEIGHT_M, round(float(np.degrees(np.arctan2(-x, -y))) % 360.0, 1))
        for k, (x, y) in enumerate(corners)
    ]


if __name__ == "__main__":
    folder = Path(__file__).parent
    write_lines(folder / f"{folder.name}.sumocfg", CONFIGURATION)
    write_lines(folder / "sites.add.xml", sites_file(sites()))
