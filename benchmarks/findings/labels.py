"""The cost of labelling relative to the simulation, and how it grows with the length of the recording.

Recordings of the bundled motorway of growing length, up to an hour, are labelled and searched for samples. Times are
CPU seconds on one thread. The peak memory is that of the process so far, mapped pages of the recording included.

Run: python -m isac_cosim.benchmarks.findings.labels [SECONDS ...]
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from isac_cosim.base.files import json_text
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings

SCENARIO = "motorway"
SEED = 1
DURATIONS_S = (240.0, 960.0, 3600.0)


def run(durations_s: Sequence[float] = DURATIONS_S) -> list[dict[str, Any]]:
    """Measure recordings of several durations; return one entry for each, shortest first.

    Keys: `duration_s`, `vehicle_hours`, `traffic_s`, `labels_s`, `ratio` (labels over traffic), `events`, `samples`,
    and `peak_mb` before and after labelling.
    """
    with threadpool_limits(1):
        return [_measured(duration_s) for duration_s in sorted(durations_s)]


def _measured(duration_s: float) -> dict[str, Any]:
    begin = time.process_time()
    recording = record(load(SCENARIO), SEED, TrafficSettings(duration_s=duration_s), ManeuverSettings())
    recorded, before = time.process_time(), _peak_mb()
    surroundings = Surroundings(recording)
    labels = label(recording, LabelSettings(), surroundings)
    offered = candidates(recording, labels, PairSettings(), RecordSettings(), surroundings)
    labelled = time.process_time()
    return {
        "duration_s": duration_s,
        "vehicle_hours": round(sum(map(len, recording.tracks.values())) * recording.step_s / 3600.0, 2),
        "traffic_s": round(recorded - begin, 2),
        "labels_s": round(labelled - recorded, 2),
        "ratio": round((labelled - recorded) / (recorded - begin), 4),
        "events": len(labels.events),
        "samples": len(offered.samples),
        "peak_mb": {"recorded": before, "labelled": _peak_mb()},
    }


def _peak_mb() -> int:
    """Return the peak memory of this process so far, MB. Linux reports it in kB."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000)


if __name__ == "__main__":
    for duration in [float(word) for word in sys.argv[1:]] or DURATIONS_S:
        print(json_text(run([duration])[0]), flush=True)
