"""How far detections are off where vehicles are near each other in the cells, which the tracker has to allow for.

All vehicles of a motorway recording are sensed now and then, detections are given to the vehicles where they truly are,
and their errors are sorted by the distance of the nearest other vehicle: along the axis on which it is largest, cells.

Run: python -m isac_cosim.benchmarks.findings.sensing.scene_crowding [SEED] [EVERY]
"""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np

from isac_cosim.isacsim.scene.association import associate_truly
from isac_cosim.isacsim.scene.episode import SceneSensing
from isac_cosim.isacsim.scene.vehicles import instants
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.sensors.scene import setup_of
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy

EDGES = (0.0, 0.6, 0.9, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0, np.inf)


def main() -> None:
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 7701
    every = int(sys.argv[2]) if len(sys.argv) > 2 else 97
    study = DatasetStudy.model_validate({"scenarios": ("motorway",), "traffic": {"duration_s": 120.0}})
    source = motion_source(study)
    scenario = source.load("motorway")
    recording = recorded(source, scenario, seed)
    setup = setup_of(SensingSettings.model_validate({"scene": {}}), study.motion)
    sensing = SceneSensing(setup, scenario.sites, recording.lanes, recording.scenario, seed)
    per_unit = np.abs(setup.numerology.waveform.cells_per_unit)
    errors, nearest = [], []
    for fix, present in instants(recording, setup.scene.fixes_hz, setup.motion):
        if fix % every:
            continue
        detections, true, view = sensing.sensed(fix, present)
        pairs = associate_truly(detections, true, view, per_unit, 1e9)
        true = true[:, :, 0]
        for vehicle, panel, number in zip(pairs.track, pairs.panel, pairs.detection, strict=True):
            apart = np.abs((true[:, panel] - true[vehicle, panel]) * per_unit).max(axis=1)
            apart[~view[:, panel]] = apart[vehicle] = np.inf
            errors.append((detections[panel].measured[number] - true[vehicle, panel]) * per_unit)
            nearest.append(apart.min())
    error, distance = np.array(errors), np.array(nearest)
    print("nearest vehicle, cells | detections | rms error of angle, range, Doppler, cells")
    for low, high in pairwise(EDGES):
        inside = (distance >= low) & (distance < high)
        rms = np.sqrt((error[inside] ** 2).mean(axis=0)) if inside.any() else np.full(3, np.nan)
        print(f"{low:g} to {high:g} | {inside.sum()} | " + ", ".join(f"{value:.4f}" for value in rms))


if __name__ == "__main__":
    main()
