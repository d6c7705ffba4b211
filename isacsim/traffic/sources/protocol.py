"""The contract of a motion source: where recordings come from, and what they depend on.

A source is a class. Subclass `MotionSource`, and register the class: in `registry`, or in another package as an entry
point of the group `isac_cosim.motion_sources`. `docs/extending.md` shows one that reads files.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import content_digest
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording
from isac_cosim.isacsim.traffic.sources.sumo import Moment, TrafficSettings


class MotionSource(Protocol):
    """Where motion comes from. Made with its settings, by section, as keyword arguments: `Source(csv=CsvSettings())`.

    It is sent to worker processes, so it must pickle, and equal sources must hash equally; frozen dataclasses do.
    Equal sources, scenarios and seeds must give equal recordings, in every process.

    sections: the settings that it brings, by the name of their section in `[dataset]`; usually one, named like the
    source. worlds: named values of these sections, by name; what a world does not give has its default, and so has
    everything in the first one. natural: the world in which drivers are left alone, None where nobody commands them.
    own_scenarios: those that are meant where none is named. default_seeds: first and last seed where none are given.
    duration: section and setting of the length of a recording, s; None where it cannot be chosen.
    """

    sections: ClassVar[Mapping[str, type[Settings]]] = {}
    worlds: ClassVar[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {}
    natural: ClassVar[str | None] = None
    own_scenarios: ClassVar[tuple[str, ...]] = ()
    default_seeds: ClassVar[tuple[int, int]] = (1, 20)
    duration: ClassVar[tuple[str, str] | None] = None

    def __hash__(self) -> int:
        return object.__hash__(self)

    @classmethod
    def recognises(cls, where: Path) -> bool:
        """Return whether a file is one that this source reads, by its name and its beginning. Raises InputError where
        it cannot be read."""
        return False

    def load(self, where: str) -> Scenario:
        """Return the road and the sites for what the user named: a scenario, a file or a folder of recordings.

        The roads may come from a SUMO network or from the recordings themselves; `Scenario.network` is then the file
        that describes them. Raises InputError where it is missing or cannot be read.
        """
        ...

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        """Return a digest of everything that recordings of a scenario depend on, by what a refusal calls it.

        `base.files.digests_of` makes them from files. They are part of what identifies a dataset: one that was begun
        with other files is refused by the name of the first that differs.
        """
        ...

    def digest(self, scenario: Scenario) -> str:
        """Return one digest of all the inputs."""
        return content_digest(dict(self.inputs(scenario)))

    def seeds(self, scenario: Scenario) -> Sequence[int] | None:
        """Return the seeds of which there are recordings, ascending, such as the blocks of a file; None: any seed."""
        return None

    def record(self, scenario: Scenario, seed: int) -> Recording:
        """Return the recording of a scenario and seed.

        A source that knows what each target vehicle does returns a `LabelledRecording`. Its maneuvers become the
        samples, with its labels, and the detectors are only compared with them; otherwise they give the labels.
        Raises InputError where the scenario itself is at fault: no other seed is tried then. Any other error costs
        this seed only.
        """
        ...

    def remarks(self, scenario: Scenario) -> Sequence[str]:
        """Return what the author of a scenario should know before it is used, a line each."""
        return ()

    def drivers_at(self, scenario: Scenario, thresholds: Mapping[str, float]) -> Sequence[str]:
        """Return what is to be said of drivers whose limits sit at thresholds of the labels, a line each.

        thresholds: of the limits `accel` and `decel`, m/s2.
        """
        return ()

    def expected_cpu_s(self) -> float:
        """Return about how much processor time one recording takes, s, for estimates."""
        return 1.0

    def expected_episodes(self, seeds: int) -> int:
        """Return about how many recordings of one scenario there are among so many seeds, for estimates."""
        return seeds

    def expected_samples(self) -> float:
        """Return about how many samples one recording could give, for estimates."""
        return math.inf


@runtime_checkable
class RunningSource(MotionSource, Protocol):
    """A source whose world runs while it is recorded, so that it can be watched and its vehicles commanded."""

    @property
    def traffic(self) -> TrafficSettings:
        """How the world is stepped, and how its drivers sway."""
        ...

    def run(self, scenario: Scenario, seed: int) -> Generator[Moment, None, Recording]:
        """Do what `record` does, and pause before every step; see `sumo.record_stepwise`."""
        ...


def recorded(source: MotionSource, scenario: Scenario, seed: int) -> Recording:
    """Return a source's recording. Raises InputError where it is not the one that was asked for, or is malformed."""
    recording = source.record(scenario, seed)
    if (recording.scenario, recording.seed) != (scenario.name, seed):
        raise InputError(
            f"source {type(source).__name__}: gave the recording of {recording.scenario}, seed {recording.seed}, for "
            f"{scenario.name}, seed {seed}; fix its package"
        )
    for name, track in recording.tracks.items():
        columns = [getattr(track, column) for column in COLUMNS]
        whole = len({len(column) for column in columns}) == 1 and all(np.isfinite(column).all() for column in columns)
        if not whole or (len(track) and not 0 <= track.lane.min() <= track.lane.max() < len(recording.lanes)):
            raise InputError(
                f"source {type(source).__name__}: {scenario.name}, seed {seed}: the states of vehicle {name} are not "
                "finite, of different lengths, or in no lane; fix the files or the source's package"
            )
    return recording
