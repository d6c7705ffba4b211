"""Generation with blockage: the vehicles of the recording that stand between a site and the TV take off its echo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.generation.generate import generate
from tests.support.scripted import InlineEngine, ScriptedSource, small_study


class BesideATruck(ScriptedSource):
    """A truck drives abreast of the vehicle that brakes, on the side of the sites to the south."""

    def record(self, scenario: Scenario, seed: int) -> Recording:
        recording = super().record(scenario, seed)
        braking = recording.tracks["follow0"]
        truck = replace(
            braking, vehicle="truck", kind="truck", length_m=16.0, width_m=2.5, x=braking.x + 5.0, y=braking.y - 4.0,
            lane_lat=braking.lane_lat - 4.0,
        )  # fmt: skip
        return replace(recording, tracks={**recording.tracks, "truck": truck})


def test_a_truck_between_site_and_vehicle_takes_off_the_echo(tmp_path: Path) -> None:
    source = BesideATruck(tmp_path)
    snr = {}
    for blockage in (False, True):
        channel = {"kind": "fixed", "snr_db": 10.0, "blockage": blockage}
        study = small_study(seeds={"first": 1, "last": 1}, sensing={"channel": channel})
        frame = generate(study, tmp_path / str(blockage), InlineEngine(), source=source).frame()
        snr[blockage] = frame.set_index(["tv_id", "t_start"])["snr_db"]
    assert (snr[False] == 10.0).all()
    lost = (snr[False] - snr[True]).groupby("tv_id").min()
    # Half of the sites look past the truck: twice 5 to 9 dB and more from each of the others (TR 37.885).
    assert 3.0 < lost["follow0"] < 20.0
    assert np.isclose(lost["follow1"], 0.0)
