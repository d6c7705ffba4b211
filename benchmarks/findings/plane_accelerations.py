"""How often vehicles of simulated traffic accelerate across their direction of travel more than drivers do.

Traffic of each scenario is recorded for a minute. Of the records around its events, swerves excepted, the share is
measured in which the target vehicle or the own vehicle accelerates across by more than 4 m/s2: with the road as it is,
with its corners rounded, and of the records that reach a dataset.

Run: python -m isac_cosim.benchmarks.findings.plane_accelerations SCENARIO ...
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings, across_travel, on_rounded_road, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import Candidate, RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings

SEED = 1
DURATION_S = 60.0
RATE_HZ = 100.0
LIMIT_MPS2 = 4.0
AS_IT_IS = MotionSettings(max_shift_m=0.0)
ROUNDED = MotionSettings()


def measured(where: str, duration_s: float = DURATION_S) -> dict[str, Any]:
    """Return the shares of one scenario.

    Keys: `records`, their number before any is left out, without swerves; `share_as_it_is`, `share_rounded` and
    `share_kept`, the shares in which the TV or the UV exceeds 4 m/s2 across; `peak_as_it_is`, `peak_rounded` and
    `peak_kept`, the largest acceleration across, m/s2; `beyond_car` and `beyond_driver`, the events left out;
    `shift_m`, by how much rounding moved vehicles: 50 %, 99 % of all rows, and most.
    """
    recording = record(load(where), SEED, TrafficSettings(duration_s=duration_s), ManeuverSettings())
    surroundings = Surroundings(recording)
    labels = label(recording, LabelSettings(), surroundings)
    everything, kept = (
        candidates(recording, labels, PairSettings(), RecordSettings(), surroundings, motion)
        for motion in (None, ROUNDED)
    )
    samples = [sample for sample in everything.samples if sample.intention is not Intention.EVASIVE_SWERVE]
    chosen = [sample for sample in kept.samples if sample.intention is not Intention.EVASIVE_SWERVE]
    peaks = {
        "as_it_is": np.array([_peak_across(recording, sample, AS_IT_IS) for sample in samples]),
        "rounded": np.array([_peak_across(recording, sample, ROUNDED) for sample in samples]),
        "kept": np.array([_peak_across(recording, sample, ROUNDED) for sample in chosen]),
    }
    vehicles = {vehicle for sample in samples for vehicle in (sample.tv, sample.uv)}
    shifts = [on_rounded_road(recording, recording.tracks[vehicle], ROUNDED).shift_m for vehicle in sorted(vehicles)]
    return {
        "scenario": where,
        "records": len(samples),
        **{f"share_{name}": round(float((values > LIMIT_MPS2).mean()), 4) for name, values in peaks.items()},
        **{f"peak_{name}": round(float(values.max()), 1) for name, values in peaks.items()},
        **{reason: kept.left_out.get(reason, 0) for reason in ("beyond_car", "beyond_driver")},
        "shift_m": [round(float(value), 3) for value in np.percentile(np.concatenate(shifts), [50.0, 99.0, 100.0])],
    }


def _peak_across(recording: Recording, sample: Candidate, motion: MotionSettings) -> float:
    """Return the largest acceleration across the direction of travel in a record, of its TV and its UV, m/s2."""
    times = sample.t_start + np.arange(round(RecordSettings().duration_s * RATE_HZ)) / RATE_HZ
    pair = [states(recording, recording.tracks[vehicle], times, motion) for vehicle in (sample.tv, sample.uv)]
    return max(float(np.abs(across_travel(state[2:4], state[4:6])).max()) for state in pair)


def run(scenarios: Sequence[str]) -> None:
    for where in scenarios:
        print(json.dumps(measured(where)), flush=True)


if __name__ == "__main__":
    run(sys.argv[1:])
