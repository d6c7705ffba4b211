"""How much memory a long recording takes, and whether that grows with simulated time.

The bundled motorway is recorded and labelled, and the memory of the process is read ten times a second. Anonymous
memory is what the process itself holds. The resident size also counts pages of its temporary files, which the system
may drop.
Linux only, because it reads /proc.

Run: python -m isac_cosim.benchmarks.findings.memory [SIMULATED SECONDS, 3600 if not given]
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import json_text
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy

SCENARIO = "motorway"
SEED = 1
EVERY_S = 0.1
STATUS = Path("/proc/self/status")
QUANTITIES = {"anonymous_mib": "RssAnon:", "resident_mib": "VmRSS:"}


def run(duration_s: float = 3600.0) -> dict[str, Any]:
    """Measure. Returns peaks in MiB, of `recording`, of its first tenth alone, and of `labelling`."""
    if not STATUS.is_file():
        raise InputError(f"this benchmark reads {STATUS}, which only Linux has: run it there")
    study = checked(DatasetStudy, {"scenarios": [SCENARIO], "traffic": {"duration_s": duration_s}}, "study")
    with sampled() as recording:
        recorded = record(load(SCENARIO), SEED, study.of(TrafficSettings), ManeuverSettings())
    with sampled() as labelling:
        labels = label(recorded, study.labels)
    return {
        "recording": peaks(recording),
        "recording_first_tenth": peaks(recording[: len(recording) // 10 + 1]),
        "labelling": peaks(labelling),
        "rows": sum(map(len, recorded.tracks.values())),
        "vehicles": len(recorded.tracks),
        "events": len(labels.events),
        "duration_s": duration_s,
    }


@contextmanager
def sampled() -> Iterator[list[dict[str, float]]]:
    """Yields a list that fills with the memory of the process, MiB, every tenth of a second while the block runs."""
    samples = [_memory()]
    done = threading.Event()

    def watch() -> None:
        while not done.wait(EVERY_S):
            samples.append(_memory())

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield samples
    finally:
        done.set()
        watcher.join()
        samples.append(_memory())


def _memory() -> dict[str, float]:
    words = STATUS.read_text().split()
    return {name: int(words[words.index(field) + 1]) / 1024.0 for name, field in QUANTITIES.items()}


def peaks(samples: list[dict[str, float]]) -> dict[str, float]:
    """Return the largest of each quantity, MiB."""
    return {name: round(max(sample[name] for sample in samples)) for name in QUANTITIES}


if __name__ == "__main__":
    began = time.monotonic()
    results = run(*map(float, sys.argv[1:2]))
    print(json_text({**results, "wall_s": round(time.monotonic() - began)}, 2))
