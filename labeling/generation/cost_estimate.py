"""Estimates the cost of generating a dataset: processor time, samples and disk space.

The estimate uses measured constants and does not look at the scenarios. The constants come from the bundled motorway
with default settings, one episode on one thread (`cosim generate motorway`, seed 1): 45 s of processor time for 330
simulated seconds, 5.4 s for 118 records of 2000 sensing instants, 130 of the 140 samples that the selection allows, and
58 kB for a sample of 2000 and 500 instants. Other networks and other machines may differ severalfold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from isac_cosim.isacsim.sensing.sensors import SCENE, SENSORS
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN

SENSED_S = 23e-6
"""Processor time per sensing instant, s."""
YIELD = 0.9
"""Samples that a long episode gives, as a share of those that the selection allows; a shorter one gives fewer."""
INSTANT_BYTES = 12.9
"""Bytes on disk per state of a TV or UV; a TV has two at each instant, the sensed and the true one."""


@dataclass(frozen=True)
class EpisodeCost:
    """The size and cost of a dataset.

    cpu_s: processor time to generate it, s. bytes: its size on disk.
    """

    episodes: int
    samples: int
    cpu_s: float
    bytes: int


def estimate(study: DatasetStudy) -> EpisodeCost:
    """Estimate the cost of generating a study's dataset."""
    source, record, selection = motion_source(study), study.record, study.selection
    allowed = len(KNOWN) * selection.per_class + selection.following
    per_episode = YIELD * min(allowed, source.expected_samples())
    episodes = source.expected_episodes(len(study.seeds)) * len(study.scenarios)
    if selection.windows is not None:
        episodes = min(episodes, math.ceil(selection.windows / per_episode))
    samples = round(episodes * per_episode)
    tv, uv = record.duration_s * record.tv_rate_hz, record.duration_s * record.uv_rate_hz
    instant_s = SENSED_S + (0.0 if study.sensing.scene is None else SENSORS[SCENE].cost_s)
    cpu_s = episodes * source.expected_cpu_s() + samples * tv * instant_s
    return EpisodeCost(episodes, samples, round(cpu_s, 1), round(samples * (2 * tv + uv) * INSTANT_BYTES))


def sensed_anew(study: DatasetStudy, generated: EpisodeCost, sensor: str) -> EpisodeCost:
    """Estimate the cost of sensing all records of a study's dataset anew.

    generated: the estimate of generating that dataset. sensor: a registered one.
    """
    instants = generated.samples * study.record.duration_s * study.record.tv_rate_hz
    return EpisodeCost(0, generated.samples, round(instants * SENSORS[sensor].cost_s, 1), generated.bytes)
