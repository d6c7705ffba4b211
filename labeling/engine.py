"""The execution engine: independent tasks on dask.distributed workers, one process each."""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import dask
from distributed import Client, Future, LocalCluster, as_completed

Item = TypeVar("Item")
Result = TypeVar("Result")

RETRIES = 2
"""How often a task that failed, or whose worker died, is tried again."""

ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""What tells numerical libraries how many threads to take."""


@dataclass(frozen=True)
class Outcome(Generic[Item, Result]):
    """What became of one item: its result, or the error of its last try."""

    item: Item
    result: Result | None = None
    error: BaseException | None = None


class Engine(Protocol):
    """What runs tasks."""

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        """Outcomes of task(item), as they come.

        Items are taken from the iterable only as workers come free. Closing the iterator ends what is under way.
        """


@dataclass(frozen=True)
class LocalEngine:
    """`jobs` worker processes on this machine, one thread each; a worker that dies is replaced.

    Numerical libraries get one thread a worker: results do not depend on `jobs`.
    """

    jobs: int

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        settings = {
            "distributed.scheduler.allowed-failures": RETRIES,
            "distributed.scheduler.worker-saturation": 1.0,
            "distributed.worker.daemon": False,
            "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, "1"),
        }
        with (
            dask.config.set(settings),
            LocalCluster(
                n_workers=self.jobs,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                # Any free port, so that commands side by side do not warn of each other's.
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
            ) as cluster,
            Client(cluster) as client,
        ):
            yield from run_on(client, task, items, self.jobs)


def run_on(
    client: Client, task: Callable[[Item], Result], items: Iterable[Item], at_once: int
) -> Generator[Outcome[Item, Result]]:
    """Run tasks on a cluster, `at_once` of them at a time."""
    waiting = enumerate(items)
    pending: dict[Future[Result], Item] = {}
    finished = as_completed()

    def submit() -> None:
        for number, item in waiting:
            future = client.submit(task, item, pure=False, retries=RETRIES, priority=-number)
            pending[future] = item
            finished.add(future)
            return

    try:
        for _ in range(at_once):
            submit()
        while pending:
            future = next(finished)
            item = pending.pop(future)
            if future.status == "finished":
                yield Outcome(item, result=future.result())
            else:
                yield Outcome(item, error=future.exception())
            submit()
    finally:
        client.cancel(list(pending))
