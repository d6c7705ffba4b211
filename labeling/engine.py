"""The execution engine: independent tasks on dask.distributed workers, one process each."""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

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


@contextmanager
def local_cluster(jobs: int) -> Iterator[Client]:
    """A client of `jobs` worker processes on this machine, one thread each, that end with the context.

    A worker that dies is replaced. Numerical libraries get one thread a worker: results do not depend on `jobs`.
    """
    settings = {
        "distributed.scheduler.allowed-failures": RETRIES,
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.worker.daemon": False,
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, "1"),
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def run_all(
    client: Client, task: Callable[[Item], Result], items: Iterable[Item], at_once: int
) -> Iterator[Outcome[Item, Result]]:
    """Outcomes of task(item), as they come; items are taken from the iterable only as workers come free.

    at_once: tasks under way at a time. Closing the iterator cancels what is under way.
    """
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
