"""What a drone saw, a CSV file: block,vehicle,frame,x,y,speed,lane,lane_pos,lane_lat."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import pandas as pd
from pydantic import Field

from isac_cosim.base.files import digests_of
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording, Track
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource


class DroneSettings(Settings):
    frame_s: float = Field(0.04, gt=0.0, le=0.1, description="time between two frames, s")


@dataclass(frozen=True)
class Drone(MotionSource):
    drone: DroneSettings
    sections: ClassVar = {"drone": DroneSettings}

    def load(self, where):
        return replace(load("straight_road"), name=Path(where).stem, network=Path(where))

    def inputs(self, scenario):
        return digests_of([scenario.network])

    def seeds(self, scenario):
        return sorted(set(pd.read_csv(scenario.network)["block"].tolist()))

    def record(self, scenario, seed):
        tracks, seen = {}, pd.read_csv(scenario.network, dtype={"vehicle": str}).query("block == @seed")
        for name, rows in seen.groupby("vehicle"):
            columns = (rows[column].to_numpy() for column in COLUMNS)
            tracks[name] = Track(name, "passenger", 4.5, 1.8, int(rows["frame"].iloc[0]), *columns)
        return Recording(scenario.name, seed, self.drone.frame_s, scenario.lanes, tracks)
