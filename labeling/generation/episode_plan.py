"""Decides how many episodes a dataset needs, whatever the order in which they finish."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

from labeling.dataset.dataset import Lost, Shard
from labeling.generation.settings import SeedRange, SelectionSettings
from labeling.intentions import KNOWN


@dataclass(frozen=True)
class Job:
    """One episode to generate.

    where: path or bundled name from which the source loads the scenario. scenario: its name.
    """

    where: str
    scenario: str
    seed: int


@dataclass(frozen=True)
class Jobs(Sequence[Job]):
    """All jobs of a dataset: every scenario with the first seed, then every scenario with the next one.

    Jobs are created on access, because a range of seeds may be very long. scenarios: path and name of each.
    """

    scenarios: tuple[tuple[str, str], ...]
    seeds: SeedRange

    def __len__(self) -> int:
        return len(self.scenarios) * len(self.seeds)

    @overload
    def __getitem__(self, number: int) -> Job: ...

    @overload
    def __getitem__(self, number: slice) -> list[Job]: ...

    def __getitem__(self, number: int | slice) -> Job | list[Job]:
        if isinstance(number, slice):
            return [self[index] for index in range(len(self))[number]]
        offset, index = divmod(range(len(self))[number], len(self.scenarios))
        return Job(*self.scenarios[index], self.seeds.first + offset)

    def find(self, scenario: str, seed: int) -> Job | None:
        """Return the job of a scenario, given by its name, and a seed; None if the dataset has no such job."""
        where = {name: where for where, name in self.scenarios}.get(scenario)
        in_range = self.seeds.first <= seed <= self.seeds.last
        return Job(where, scenario, seed) if where is not None and in_range else None


@dataclass
class Plan:
    """Chooses the episodes of a dataset: the shortest run of jobs, from the first on, that satisfies the selection.

    The run depends on what the episodes hold and never on the order in which they finish.
    finished: every episode so far, also beyond the run. length: number of jobs in the run so far.
    """

    jobs: Sequence[Job]
    selection: SelectionSettings
    finished: dict[Job, Shard | Lost] = field(default_factory=dict)
    length: int = 0
    _counts: Counter[str] = field(default_factory=Counter)
    _idle: int = 0

    def add(self, job: Job, episode: Shard | Lost) -> None:
        """Add a finished episode."""
        self.finished[job] = episode
        while not self.done and (next_episode := self.finished.get(self.jobs[self.length])) is not None:
            counts = next_episode.by_intention if isinstance(next_episode, Shard) else {}
            self._counts.update(counts)
            self._idle = 0 if counts else self._idle + 1
            self.length += 1

    @property
    def done(self) -> bool:
        """Whether the run is complete."""
        return self.length == len(self.jobs) or self.satisfied or self.hopeless

    @property
    def satisfied(self) -> bool:
        """Whether the run so far holds enough samples."""
        wanted = self.selection.windows
        return wanted is not None and self._counts.total() >= wanted and not self.short()

    @property
    def hopeless(self) -> bool:
        """Whether too many episodes in a row held no sample."""
        return self.selection.windows is not None and self._idle >= self.selection.patience

    def short(self) -> tuple[str, ...]:
        """Return the known intentions of which the run so far holds fewer samples than required."""
        return tuple(known.text for known in KNOWN if self._counts[known.text] < self.selection.min_per_class)

    def missing(self) -> Iterator[Job]:
        """Yield the jobs that are not finished yet, in order, until the run is complete."""
        for job in self.jobs:
            if self.done:
                return
            if job not in self.finished:
                yield job

    def run(self) -> list[Shard | Lost]:
        """Return the episodes of the run, in the order of its jobs."""
        return [self.finished[job] for job in self.jobs[: self.length]]

    def progress(self) -> tuple[int, int]:
        """Return how many samples, or else episodes, are finished, and how many there will be."""
        wanted = self.selection.windows
        if wanted is None:
            return len(self.finished), len(self.jobs)
        least = self.selection.min_per_class
        shares = [self._counts[known.text] / least for known in KNOWN] if least else []
        return int(wanted * min([1.0, self._counts.total() / wanted, *shares])), wanted
