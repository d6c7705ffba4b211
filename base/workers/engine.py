"""The execution engine: runs independent tasks in worker processes, on this machine or on a cluster.

The results are the same. `LocalEngine` starts processes of its own (`base.workers.pool`); a cluster is a
dask scheduler that is already running (`base.workers.cluster`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import joblib

from isac_cosim.base.workers.attempts import Item, Outcome, Result, try_task
from isac_cosim.base.workers.pool import WorkerPool, worker_pool


class Engine(Protocol):
    """Runs tasks."""

    @property
    def workers(self) -> int:
        """The number of worker processes at the moment, at least 1."""

    @property
    def cores(self) -> int:
        """The number of processor cores that the workers share, at most one each."""

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        """Yield the outcome of task(item) for every item, in the order in which they finish.

        threads: that a task uses. Of `workers` processes, every `threads`-th one gets a task, and at least one does.
        Takes an item from the iterable only when a worker is free for it. Closing the generator ends the running tasks.
        Raises the InputError, OutputError or ShortageError of a task, because no other task would fare better.
        """


@dataclass(frozen=True)
class LocalEngine:
    """Runs tasks in `jobs` worker processes of this machine, and replaces a worker that dies.

    A worker has one thread, numerical libraries included, so that results do not depend on `jobs`.
    output: the folder that the command writes, if it is known.
    """

    jobs: int
    output: Path | None = None

    @property
    def workers(self) -> int:
        return self.jobs

    @property
    def cores(self) -> int:
        return min(self.jobs, cpu_count())

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        with self.started() as pool:
            yield from pool.run(task, items, self.jobs // threads)

    def started(self) -> AbstractContextManager[WorkerPool]:
        """Return worker processes that end with the block."""
        return worker_pool(self.output)


class InlineEngine:
    """Runs tasks in this process, one after another, and does not retry."""

    workers = cores = 1

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        for item in items:
            attempt = try_task(task, item)
            if attempt.stop is not None:
                raise attempt.stop
            yield Outcome(item, attempt.result, attempt.error, attempt.seconds)


def cpu_count() -> int:
    """Return how many processor cores this process may use, its affinity and the container's limit considered."""
    return int(joblib.cpu_count())
