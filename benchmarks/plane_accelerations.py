"""How often vehicles of simulated traffic accelerate across their direction of travel more than drivers do.

Traffic of each scenario is recorded for a minute. Of the records around its events, swerves excepted, the share is
measured in which the target vehicle or the own vehicle accelerates across by more than 4 m/s2: with the road as it is,
and with its corners rounded and the records that are still beyond a car left out.

Run: python -m benchmarks.plane_accelerations SCENARIO ...
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from isacsim.arrays import Array
from isacsim.scenarios.scenario import load
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.motion import MotionSettings, on_rounded_road, states
from isacsim.traffic.recording import Recording
from isacsim.traffic.simulation import TrafficSettings, record
from labeling.detectors.settings import LabelSettings
from labeling.events import label
from labeling.intentions import Intention
from labeling.road.surroundings import Surroundings
from labeling.samples.candidates import Candidate, RecordSettings, candidates
from labeling.samples.uv_choice import PairSettings

SEED = 1
DURATION_S = 60.0
RATE_HZ = 100.0
LIMIT_MPS2 = 4.0
LEAST_SPEED_MPS = 1.0
"""Below, a vehicle has no direction of travel."""
AS_IT_IS = MotionSettings(max_shift_m=0.0)
ROUNDED = MotionSettings()


def measured(where: str, duration_s: float = DURATION_S) -> dict[str, Any]:
    """Return the shares of one scenario.

    Keys: `records` with swerves left out; `share_before` and `share_after`, in which the TV or the UV exceeds 4 m/s2
    across; `peak_before` and `peak_after`, the largest acceleration across, m/s2; `beyond_car`, the records left out of
    the shares after; `shift_m`, by how much rounding moved vehicles: 50 %, 99 % of all rows, and most.
    """
    recording = record(load(where), SEED, TrafficSettings(duration_s=duration_s), ManeuverSettings())
    surroundings = Surroundings(recording)
    labels = label(recording, LabelSettings(), surroundings)
    offered = [
        [
            sample
            for sample in candidates(recording, labels, PairSettings(), RecordSettings(), surroundings, motion).samples
            if sample.intention is not Intention.EVASIVE_SWERVE
        ]
        for motion in (None, ROUNDED)
    ]
    before = np.array([_peak_across(recording, sample, AS_IT_IS) for sample in offered[0]])
    after = np.array([_peak_across(recording, sample, ROUNDED) for sample in offered[1]])
    vehicles = {vehicle for sample in offered[0] for vehicle in (sample.tv, sample.uv)}
    shifts = [on_rounded_road(recording, recording.tracks[vehicle], ROUNDED).shift_m for vehicle in sorted(vehicles)]
    return {
        "scenario": where,
        "records": len(before),
        "share_before": round(float((before > LIMIT_MPS2).mean()), 4),
        "share_after": round(float((after > LIMIT_MPS2).mean()), 4),
        "peak_before": round(float(before.max()), 1),
        "peak_after": round(float(after.max()), 1),
        "beyond_car": len(before) - len(after),
        "shift_m": [round(float(value), 3) for value in np.percentile(np.concatenate(shifts), [50.0, 99.0, 100.0])],
    }


def _peak_across(recording: Recording, sample: Candidate, motion: MotionSettings) -> float:
    """Return the largest acceleration across the direction of travel in a record, of its TV and its UV, m/s2."""
    times = sample.t_start + np.arange(round(RecordSettings().duration_s * RATE_HZ)) / RATE_HZ
    pair = [states(recording, recording.tracks[vehicle], times, motion) for vehicle in (sample.tv, sample.uv)]
    return max(float(np.abs(across(state)).max()) for state in pair)


def across(state: Array) -> Array:
    """Return the acceleration across the direction of travel, left positive, m/s2, shape (n,). state: (6, n)."""
    speed = np.hypot(state[2], state[3])
    moving = speed > LEAST_SPEED_MPS
    return np.asarray(np.where(moving, state[2] * state[5] - state[3] * state[4], 0.0) / np.maximum(speed, 1.0))


def run(scenarios: Sequence[str]) -> None:
    for where in scenarios:
        print(json.dumps(measured(where)), flush=True)


if __name__ == "__main__":
    run(sys.argv[1:])
