"""Records the episodes of a dataset again, from its stored study, for sensors that need all vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.scenarios.scenario import Scenario, resolved
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.dataset.dataset import Dataset, Sample
from isac_cosim.labeling.dataset.record_point import relative
from isac_cosim.labeling.generation.settings import DatasetStudy, as_stored, driven_by_profiles

LEAST_SCHEMA = 3
"""Datasets of earlier schemas have other drivers."""
SCENE_NEEDS = "a scene needs all vehicles"
ANEW = "generate the dataset anew with --scene"


@dataclass(frozen=True)
class Recorder:
    """Records episodes of a dataset again.

    where: from which the source loads each scenario, by the scenario's name. why, remedy: what a refusal says it is
    for, and what there is to be done.
    """

    dataset: Path
    study: DatasetStudy
    source: MotionSource
    where: Mapping[str, str]
    why: str = SCENE_NEEDS
    remedy: str = ANEW

    @classmethod
    def of(cls, dataset: Dataset, why: str = SCENE_NEEDS, remedy: str = ANEW) -> Self:
        """Return what records a dataset's episodes. Raises InputError if its scenarios or its study are not as then."""
        if dataset.meta.schema_version < LEAST_SCHEMA or driven_by_profiles(dataset.meta.study):
            raise InputError(f"{dataset.path}: {why}, and an earlier version recorded them otherwise; {remedy}")
        study = checked(DatasetStudy, as_stored(dataset.meta.study), dataset.path)
        source, where = motion_source(study), {}
        for described in dataset.meta.scenarios:
            where[described.name] = resolved(described.source)
            if source.digest(_load(source, where[described.name])) != described.sha256:
                raise InputError(
                    f"{dataset.path}: {why}, and the files of {described.name} have changed since "
                    f"they were recorded; restore them, or {remedy}"
                )
        return cls(dataset.path, study, source, where, why, remedy)

    def scenario(self, name: str) -> Scenario:
        """Return a scenario of the dataset, by its name. Raises InputError where it cannot be read."""
        return _load(self.source, self.where[name])

    def record(self, scenario: str, seed: int, stored: Sequence[Sample]) -> Recording:
        """Return the recording of an episode, from which samples were made.

        stored: the samples. Raises InputError if the motion of one of them differs in a single bit.
        """
        recording = recorded(self.source, self.scenario(scenario), seed)
        for sample in stored:
            if not self._has(recording, sample):
                raise InputError(
                    f"{self.dataset}: {self.why}, and {scenario}, seed {seed}, is not the same when it is recorded "
                    f"again (vehicle {sample.tv_id}): another version of SUMO or NumPy made it; {self.remedy}"
                )
        return recording

    def _has(self, recording: Recording, sample: Sample) -> bool:
        """Return whether a recording has the motion of a sample, to the bit."""
        track = recording.tracks.get(sample.tv_id)
        if track is None or not len(track):
            return False
        times = sample.t_start + np.arange(sample.tv_truth.shape[1]) / self.study.record.tv_rate_hz
        first, last = recording.times(track)[[0, -1]]
        if not first - 1e-6 <= times[0] <= times[-1] <= last + 1e-6:
            return False
        driven = motion.states(recording, track, times, self.study.motion)
        return bool(np.array_equal(relative(driven, (sample.x0, sample.y0)), sample.tv_truth))


@lru_cache(maxsize=4)
def _load(source: MotionSource, where: str) -> Scenario:
    return source.load(where)
