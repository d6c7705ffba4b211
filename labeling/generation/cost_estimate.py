"""What a dataset will take, before any of it is made: from constants, not from the scenarios.

The constants were measured on the bundled motorway with the default settings, one episode on one thread (`cosim
generate motorway`, seed 1): 20 s of processor time for 330 simulated seconds, 5.4 s for 118 records of 2000 sensing
instants, 130 samples of 140 that the selection allowed, 58 kB a sample of 2000 and 500 instants. Another network, and
another machine, may differ severalfold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from isacsim.sensors import SENSORS
from isacsim.traffic.motion_sources import motion_source
from labeling.generation.settings import DatasetStudy
from labeling.intentions import KNOWN

SENSED_S = 23e-6
"""Processor time a sensing instant, s."""
FOUND = 0.9
"""Share of the samples that the selection allows which an episode of FULL_S holds; a shorter one holds less."""
FULL_S = 240.0
INSTANT_BYTES = 12.9
"""On disk, an instant of a TV or UV; a TV's are stored twice, sensed and true."""


@dataclass(frozen=True)
class Estimate:
    """Episodes and samples of a dataset, processor time of making it, s, and its size, bytes."""

    episodes: int
    samples: int
    cpu_s: float
    bytes: int


def estimate(study: DatasetStudy) -> Estimate:
    """What a study's dataset will take, about."""
    traffic, record, selection = study.traffic, study.record, study.selection
    allowed = len(KNOWN) * selection.per_class + selection.following
    found = FOUND * allowed * min(1.0, traffic.duration_s / FULL_S)
    episodes = len(study.seeds) * len(study.scenarios)
    if selection.windows is not None:
        episodes = min(episodes, math.ceil(selection.windows / found))
    samples = round(episodes * found)
    tv, uv = record.duration_s * record.tv_rate_hz, record.duration_s * record.uv_rate_hz
    cpu_s = episodes * motion_source(study).expected_cpu_s() + samples * tv * SENSED_S
    return Estimate(episodes, samples, round(cpu_s, 1), round(samples * (2 * tv + uv) * INSTANT_BYTES))


def sensed_anew(study: DatasetStudy, made: Estimate, sensor: str) -> Estimate:
    """What sensing all records of a study's dataset anew will take, about."""
    instants = made.samples * study.record.duration_s * study.record.tv_rate_hz
    return Estimate(0, made.samples, round(instants * SENSORS[sensor].cost_s, 1), made.bytes)
