"""How often vehicles of simulated traffic accelerate in the plane as no driver does, or otherwise than SUMO says.

Traffic of each scenario is recorded for a minute. Of the records around its events, the share is measured in which the
target vehicle or the own vehicle accelerates across its direction of travel by more than 4 m/s2, swerves excepted, and
that in which it accelerates along the road otherwise than its speed in SUMO does, by more than 0.5 m/s2: with the road
as it is, with its corners rounded, and of the records that reach a dataset.

Run: python -m isac_cosim.benchmarks.findings.plane_accelerations SCENARIO ...
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from isac_cosim.base.files import json_text
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.motion import (
    MotionSettings,
    across_travel,
    condition,
    on_rounded_road,
    road_headings,
    states,
)
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
ACROSS_MPS2, ALONG_MPS2 = 4.0, 0.5
AS_IT_IS = MotionSettings(max_shift_m=0.0)
ROUNDED = MotionSettings()


def measured(where: str, duration_s: float = DURATION_S) -> dict[str, Any]:
    """Return the shares of one scenario.

    Keys: `records`, their number before any is left out. Of `across` and of `along`, each for `as_it_is`, `rounded` and
    `kept`: the share of the records in which the TV or the UV exceeds the limit, and the peak, m/s2. Swerves are left
    out of `across`. `left_out`: the events left out because of the road, by reason. `shift_m`: by how much rounding
    moved vehicles: 50 %, 99 % of all rows, and most.
    """
    recording = record(load(where), SEED, TrafficSettings(duration_s=duration_s), ManeuverSettings())
    surroundings = Surroundings(recording)
    labels = label(recording, LabelSettings(), surroundings)
    everything, kept = (
        candidates(recording, labels, PairSettings(), RecordSettings(), surroundings, motion)
        for motion in (None, ROUNDED)
    )
    of_each = {
        "as_it_is": [_peaks(recording, sample, AS_IT_IS) for sample in everything.samples],
        "rounded": [_peaks(recording, sample, ROUNDED) for sample in everything.samples],
        "kept": [_peaks(recording, sample, ROUNDED) for sample in kept.samples],
    }
    vehicles = {vehicle for sample in everything.samples for vehicle in (sample.tv, sample.uv)}
    shifts = [on_rounded_road(recording, recording.tracks[vehicle], ROUNDED).shift_m for vehicle in sorted(vehicles)]
    return {
        "scenario": where,
        "records": len(everything.samples),
        "across": {name: _share([across for across, _ in peaks], ACROSS_MPS2) for name, peaks in of_each.items()},
        "along": {name: _share([along for _, along in peaks], ALONG_MPS2) for name, peaks in of_each.items()},
        "left_out": {reason: kept.left_out.get(reason, 0) for reason in ("beyond_car", "beyond_driver", "along")},
        "shift_m": [round(float(value), 3) for value in np.percentile(np.concatenate(shifts), [50.0, 99.0, 100.0])],
    }


def _share(peaks: Sequence[float], limit_mps2: float) -> dict[str, float]:
    """Return the share of peaks above a limit, and the highest, m/s2; those that are not finite do not count."""
    known = np.array([peak for peak in peaks if np.isfinite(peak)])
    return {"share": round(float((known > limit_mps2).mean()), 4), "peak": round(float(known.max()), 1)}


def _peaks(recording: Recording, sample: Candidate, motion: MotionSettings) -> tuple[float, float]:
    """Return the largest acceleration across in a record, and along the road the largest difference from SUMO, m/s2.

    Of its TV and its UV. A swerve has none across: NaN.
    """
    times = sample.t_start + np.arange(round(RecordSettings().duration_s * RATE_HZ)) / RATE_HZ
    across, along = [], []
    for vehicle in (sample.tv, sample.uv):
        track = recording.tracks[vehicle]
        _, _, vx, vy, ax, ay = states(recording, track, times, motion)
        across.append(float(np.abs(across_travel(np.stack([vx, vy]), np.stack([ax, ay]))).max()))
        rows, headings = times / recording.step_s - track.first_step, road_headings(recording, track, motion)
        east, north, speed_change = (
            condition(values, recording.step_s, motion.width_s, order, rows)
            for values, order in ((headings.real, 0), (headings.imag, 0), (track.speed, 1))
        )
        along.append(float(np.abs((ax * east + ay * north) / np.hypot(east, north) - speed_change).max()))
    swerve = sample.intention is Intention.EVASIVE_SWERVE
    return np.nan if swerve else max(across), max(along)


def run(scenarios: Sequence[str]) -> None:
    for where in scenarios:
        print(json_text(measured(where)), flush=True)


if __name__ == "__main__":
    run(sys.argv[1:])
