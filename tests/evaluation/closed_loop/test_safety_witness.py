"""Time to collision and DRAC against SUMO's own safety device, on three vehicles.

The device also reports pairs with a vehicle in between; only pairs of a follower and its leader are compared. It gives
the outcome of a step the time at which the step began.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from isac_cosim.base import landlock
from isac_cosim.evaluation.closed_loop.safety import driving_of
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

FOLLOWS, STEP_S = "2", 0.01
"""The device's number of a follower that closes in on its leader."""


def test_sumos_device_gives_the_same_time_to_collision_and_drac(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(landlock, "version", lambda: 0)  # the device writes a file
    slow = '<vType id="slow" carFollowModel="IDM" maxSpeed="12" length="6" speedDev="0"/>'
    ahead = '<vehicle id="ahead" type="slow" route="all" depart="0" departLane="1" departPos="160" departSpeed="12"/>'
    queue = vehicle("behind", position=60.0, speed=28.0) + vehicle("third", position=20.0, speed=28.5)
    device = {
        "device.ssm.probability": "1",
        "device.ssm.measures": "TTC DRAC",
        "device.ssm.thresholds": "50 0.01",
        "device.ssm.range": "150",
        "device.ssm.trajectories": "true",
        "device.ssm.file": str(tmp_path / "ssm.xml"),
    }
    scenario = replace(load(straight_road(tmp_path / "road", slow + ahead + queue)), kept=device)
    traffic = TrafficSettings(run_in_s=0.5, duration_s=8.0, sway=SwaySettings(sd_m=(0.0, 0.0)))
    recording = record(scenario, 1, traffic, ManeuverSettings.model_validate(LEFT_ALONE))
    driving = driving_of(recording, every_s=STEP_S)
    ours = {
        (driving.names[vehicle], step): (ttc, drac)
        for vehicle, step, ttc, drac in zip(
            driving.vehicle.tolist(),
            np.rint(driving.time_s / STEP_S).astype(int).tolist(),
            driving.ttc_s.tolist(),
            driving.drac_mps2.tolist(),
            strict=True,
        )
    }
    compared = 0
    for conflict in ElementTree.parse(tmp_path / "ssm.xml").getroot():
        if (conflict.get("ego"), conflict.get("foe")) not in (("behind", "ahead"), ("third", "behind")):
            continue
        names = ("timeSpan", "typeSpan", "TTCSpan", "DRACSpan")
        spans = [conflict.find(name).get("values").split() for name in names]
        for time, kind, ttc, drac in zip(*spans, strict=True):
            row = ours.get((str(conflict.get("ego")), round(float(time) / STEP_S) + 1))
            if kind == FOLLOWS and ttc != "NA" and row is not None:
                np.testing.assert_allclose(row, (float(ttc), float(drac)), rtol=1e-6)
                compared += 1
    assert compared > 500
