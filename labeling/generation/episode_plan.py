"""How many episodes a dataset takes: the stop rule, independent of the order in which episodes are finished."""

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
    """One episode to make. where: the scenario as the source loads it."""

    where: str
    scenario: str
    seed: int


@dataclass(frozen=True)
class Jobs(Sequence[Job]):
    """Every scenario with the first seed, then every one with the next. Made when asked for: a range may be long.

    scenarios: where each one is, and its name.
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
            return [self[each] for each in range(len(self))[number]]
        turn, which = divmod(range(len(self))[number], len(self.scenarios))
        return Job(*self.scenarios[which], self.seeds.first + turn)

    def find(self, scenario: str, seed: int) -> Job | None:
        """The job of a scenario, by its name, and a seed; None where there is none."""
        where = {name: where for where, name in self.scenarios}.get(scenario)
        within = self.seeds.first <= seed <= self.seeds.last
        return Job(where, scenario, seed) if where is not None and within else None


@dataclass
class Plan:
    """Which episodes make the dataset: the shortest run of them, from the first, that satisfies the selection.

    The run depends on what the episodes hold, never on the order in which they are finished.
    """

    jobs: Sequence[Job]
    selection: SelectionSettings
    made: dict[Job, Shard | Lost] = field(default_factory=dict)
    length: int = 0
    _counts: Counter[str] = field(default_factory=Counter)
    _idle: int = 0

    def add(self, job: Job, shard: Shard | Lost) -> None:
        """Take in a finished episode."""
        self.made[job] = shard
        while not self.done and (found := self.made.get(self.jobs[self.length])) is not None:
            counts = found.by_intention if isinstance(found, Shard) else {}
            self._counts.update(counts)
            self._idle = 0 if counts else self._idle + 1
            self.length += 1

    @property
    def done(self) -> bool:
        return self.length == len(self.jobs) or self.satisfied or self.hopeless

    @property
    def satisfied(self) -> bool:
        """Whether the run so far holds the samples asked for."""
        wanted = self.selection.windows
        return wanted is not None and self._counts.total() >= wanted and not self.short()

    @property
    def hopeless(self) -> bool:
        return self.selection.windows is not None and self._idle >= self.selection.patience

    def short(self) -> tuple[str, ...]:
        """Known intentions of which the run so far holds fewer samples than asked for."""
        return tuple(each.text for each in KNOWN if self._counts[each.text] < self.selection.min_per_class)

    def missing(self) -> Iterator[Job]:
        """The episodes still to make, in order, for as long as any is needed."""
        for job in self.jobs:
            if self.done:
                return
            if job not in self.made:
                yield job

    def run(self) -> list[Shard | Lost]:
        return [self.made[job] for job in self.jobs[: self.length]]

    def progress(self) -> tuple[int, int]:
        """How much is done, of how much."""
        wanted = self.selection.windows
        if wanted is None:
            return len(self.made), len(self.jobs)
        least = self.selection.min_per_class
        shares = [self._counts[each.text] / least for each in KNOWN] if least else []
        return int(wanted * min([1.0, self._counts.total() / wanted, *shares])), wanted
