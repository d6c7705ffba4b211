"""Simulates scenarios that make SUMO write files, without the wall that reads them first; prints what became of each.

It is a process of its own, because SUMO may not survive. Arguments: a folder that holds a straight road, and `kernel`
to leave the second wall standing, or `none`.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import sumo_config, sumo_files
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.sources import sumo as simulation
from isac_cosim.isacsim.traffic.sources.sumo import TrafficError, TrafficSettings, record
from tests.support.ways_to_write import WAYS

BRIEF = TrafficSettings(step_s=0.1, sample_s=0.1, run_in_s=0.0, duration_s=3.0)
NATURAL = ManeuverSettings(**LEFT_ALONE)


def main(where: Path, wall: str) -> None:
    here: Any = sumo_files.Handover
    here.path_of = lambda self, file: file  # files reach SUMO as they are
    here = sumo_config.sumo_schemas
    here.fits = lambda value, kind: True  # values of any type reach SUMO
    here = simulation
    here._arguments = lambda options: [
        word for name, value in options.items() for word in (f"--{name}", value) if value
    ]
    if wall == "none":
        here = landlock
        here.version = lambda: 0
    for name, way in WAYS.items():
        folder = where / name / "road"
        shutil.copytree(where / "road", folder)
        os.chdir(folder)
        written = way(folder)
        before = sorted(folder.iterdir())
        message = ""
        try:
            record(load(folder), 1, BRIEF, NATURAL)
        except (InputError, TrafficError) as error:
            message = str(error)
        print(json.dumps([name, written.exists(), sorted(folder.iterdir()) == before, message]), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
