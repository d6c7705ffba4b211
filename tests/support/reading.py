"""Reads files of trajectories as a study of them does."""

from __future__ import annotations

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy


def read(study: DatasetStudy, seed: int = 1) -> Recording:
    """The recording of the first scenario and a seed."""
    source = motion_source(study)
    return recorded(source, source.load(study.scenarios[0]), seed)


def fcd_study(file: object, network: str, **fcd: object) -> DatasetStudy:
    """The study of a file of floating car data, driven on a network, in blocks of an hour."""
    content = {"source": "fcd", "scenarios": [str(file)], "fcd": {"network": network, "block_min": 60.0, **fcd}}
    return DatasetStudy.model_validate(content)
