"""Decides how many episodes a dataset needs, whatever the order in which they finish."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import overload

from isac_cosim.labeling.dataset.dataset import Lost
from isac_cosim.labeling.generation.settings import SelectionSettings
from isac_cosim.labeling.intentions import KNOWN


@dataclass(frozen=True)
class EpisodeJob:
    """One episode to generate.

    where: path or bundled name from which the source loads the scenario. scenario: its name.
    """

    where: str
    scenario: str
    seed: int


@dataclass(frozen=True)
class Jobs(Sequence[EpisodeJob]):
    """All jobs of a dataset: every scenario with its first seed, then every scenario with its next one.

    Jobs are created on access, because a range of seeds may be very long. scenarios: path, name and seeds of each.
    """

    scenarios: tuple[tuple[str, str, Sequence[int]], ...]

    def __len__(self) -> int:
        return sum(len(seeds) for *_, seeds in self.scenarios)

    @overload
    def __getitem__(self, number: int) -> EpisodeJob: ...

    @overload
    def __getitem__(self, number: slice) -> list[EpisodeJob]: ...

    def __getitem__(self, number: int | slice) -> EpisodeJob | list[EpisodeJob]:
        if isinstance(number, slice):
            return [self[index] for index in range(len(self))[number]]
        number, scenarios, passed = range(len(self))[number], self.scenarios, 0
        # Round by round; after the last seed of the shortest scenario, the others go on without it.
        while number >= (rounds := min(len(seeds) for *_, seeds in scenarios) - passed) * len(scenarios):
            number, passed = number - rounds * len(scenarios), passed + rounds
            scenarios = tuple(scenario for scenario in scenarios if len(scenario[2]) > passed)
        offset, index = divmod(number, len(scenarios))
        where, name, seeds = scenarios[index]
        return EpisodeJob(where, name, seeds[passed + offset])

    def find(self, scenario: str, seed: int) -> EpisodeJob | None:
        """Return the job of a scenario, given by its name, and a seed; None if the dataset has no such job."""
        for where, name, seeds in self.scenarios:
            if name == scenario and seed in seeds:
                return EpisodeJob(where, scenario, seed)
        return None


Counts = Mapping[str, int]
"""Samples of an episode by intention."""


@dataclass
class EpisodePlan:
    """Chooses the episodes of a dataset: the shortest run of jobs, from the first on, that satisfies the selection.

    The run depends on what the episodes hold and never on the order in which they finish.
    length: number of jobs in the run so far. lost: the episodes of the run that failed.
    """

    jobs: Sequence[EpisodeJob]
    selection: SelectionSettings
    length: int = 0
    lost: list[Lost] = field(default_factory=list)
    _ahead: dict[EpisodeJob, Counts | Lost] = field(default_factory=dict)
    """Finished episodes that the run has not reached. Nothing is kept of those that it has, as they may be millions."""
    _counts: Counter[str] = field(default_factory=Counter)
    _idle: int = 0
    _enough_at: int | None = None
    """Length of the run when it first held as many samples as were asked for, of whatever intentions."""

    def add(self, job: EpisodeJob, episode: Counts | Lost) -> None:
        """Add a finished episode: its samples by intention, or why it was lost."""
        self._ahead[job] = episode
        while not self.done and (reached := self._ahead.pop(self.jobs[self.length], None)) is not None:
            if isinstance(reached, Lost):
                self.lost.append(reached)
            counts = {} if isinstance(reached, Lost) else {name: n for name, n in reached.items() if n}
            self._counts.update(counts)
            self._idle = 0 if counts else self._idle + 1
            self.length += 1
            wanted = self.selection.windows
            if self._enough_at is None and wanted is not None and self._counts.total() >= wanted:
                self._enough_at = self.length

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

    @property
    def difference(self) -> str | None:
        """Why the run holds another number of samples than was asked for, in a sentence; None where it does not."""
        wanted, found = self.selection.windows, self._counts.total()
        if wanted is None or found == wanted:
            return None
        said = f"{found} samples, where {wanted} were asked for: "
        if found < wanted:
            last = "the episodes hold none" if self.hopeless else "the seeds hold no more; name more with --seeds"
            return said + last
        if self._enough_at is not None and (more := self.length - self._enough_at):
            least = self.selection.min_per_class
            found_none = ", and did not find them" if self.short() else ""
            episodes = f"{more} more episode{'' if more == 1 else 's'}"
            return f"{said}{episodes} ran to have {least} of every known intention{found_none}"
        return f"{said}an episode is kept whole, and the last one that was needed ends there"

    def short(self) -> tuple[str, ...]:
        """Return the known intentions of which the run so far holds fewer samples than required."""
        return tuple(known.text for known in KNOWN if self._counts[known.text] < self.selection.min_per_class)

    def missing(self) -> Iterator[EpisodeJob]:
        """Yield the jobs that are not finished yet, in order, until the run is complete."""
        for number, job in enumerate(self.jobs):
            if self.done:
                return
            if number >= self.length and job not in self._ahead:
                yield job

    def kept(self) -> Iterator[EpisodeJob]:
        """Yield the jobs of the run that were not lost, in their order."""
        lost = {(episode.scenario, episode.seed) for episode in self.lost}
        for number in range(self.length):
            job = self.jobs[number]
            if (job.scenario, job.seed) not in lost:
                yield job

    def progress(self) -> tuple[int, int]:
        """Return how many samples, or else episodes, are finished, and how many there will be."""
        wanted = self.selection.windows
        if wanted is None:
            return self.length + len(self._ahead), len(self.jobs)
        least = self.selection.min_per_class
        shares = [self._counts[known.text] / least for known in KNOWN] if least else []
        return int(wanted * min([1.0, self._counts.total() / wanted, *shares])), wanted
