"""The execution engine: independent tasks on dask.distributed workers, one process each.

The workers are this command's own, or those of a scheduler that runs already; what a task makes is the same.
"""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed

from isacsim.errors import InputError, RunError
from isacsim.versions import OF_DATASETS, versions

Item = TypeVar("Item")
Result = TypeVar("Result")

RETRIES = 2
"""How often a task that failed, or whose worker died, is tried again."""

ANSWER_S = 15.0
"""How long a running scheduler, and the first of its workers, may take to answer."""

COUNTED_S = 1.0
"""How old the number of a cluster's workers may be."""

GONE = "the dask scheduler went away; start it, and the same command goes on from there"

ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""What tells numerical libraries how many threads to take."""


@dataclass(frozen=True)
class Outcome(Generic[Item, Result]):
    """What became of one item: its result, or in one line the error of its last try.

    seconds: that the last try took, None where its worker died. retries: tries before it.
    """

    item: Item
    result: Result | None = None
    error: str | None = None
    seconds: float | None = None
    retries: int = 0


class Engine(Protocol):
    """What runs tasks."""

    @property
    def workers(self) -> int:
        """Worker processes at the moment, at least 1."""

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

    @property
    def workers(self) -> int:
        return self.jobs

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        settings = {
            # Every death of a worker is told; run_on counts them and tries again.
            "distributed.scheduler.allowed-failures": 0,
            "distributed.scheduler.worker-saturation": 1.0,
            "distributed.worker.daemon": False,
            "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, "1"),
        }
        with dask.config.set(settings), self._started() as cluster, Client(cluster) as client:
            yield from run_on(client, task, items, lambda: self.jobs)

    def _started(self) -> LocalCluster:
        """The worker processes. Where one dies before it is ready, which ends all of them, they are started again."""
        failures = 0
        while True:
            try:
                return LocalCluster(
                    n_workers=self.jobs,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=None,
                    # Any free port, so that commands side by side do not warn of each other's.
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                    silence_logs=logging.CRITICAL,
                )
            except RuntimeError as error:
                failures += 1
                if failures > RETRIES:
                    raise RunError(f"the worker processes do not start ({describe(error)})") from None


@dataclass(frozen=True)
class ClusterEngine:
    """The workers of a dask scheduler that runs already, at an address like `tcp://10.0.0.1:8786`.

    Each worker must be a process of one thread, with the same versions as here, on a file system shared with this
    command. Workers that come or go meanwhile are taken into account.
    Raises InputError where no scheduler or no fit worker answers, RunError where the scheduler goes away.
    """

    address: str

    @property
    def workers(self) -> int:
        with self._connected() as client:
            return _worker_count(client)()

    def check(self) -> None:
        """Raises InputError where no scheduler or no fit worker answers."""
        with self._connected():
            pass

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        with self._connected() as client:
            yield from run_on(client, task, items, _worker_count(client))

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        """A client of the scheduler, whose workers are fit."""
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            client = Client(self.address, timeout=ANSWER_S)
        except Exception as error:  # an address raises whatever its parts make the library raise
            raise InputError(
                f"--cluster {self.address}: no dask scheduler answers ({describe(error)}); start one, or mend the "
                "address (tcp://HOST:PORT)"
            ) from None
        try:
            with client:
                self._check(client)
                yield client
        except OSError:
            raise RunError(GONE) from None

    def _check(self, client: Client) -> None:
        """Raises InputError where the workers are not fit for simulations."""
        try:
            client.wait_for_workers(1, timeout=ANSWER_S)
        except TimeoutError:
            raise InputError(f"--cluster {self.address}: the scheduler has no workers; start some") from None
        for worker, threads in client.nthreads().items():
            if threads != 1:
                raise InputError(
                    f"--cluster {self.address}: worker {worker} has {threads} threads, and a process runs one "
                    "simulation at a time; start it with --nthreads 1"
                )
        here = versions(OF_DATASETS)
        for worker, there in client.run(versions, OF_DATASETS, on_error="return").items():
            if isinstance(there, BaseException):
                raise InputError(
                    f"--cluster {self.address}: worker {worker} cannot load the tool ({describe(there)}); "
                    "install it there"
                )
            for name, version in here.items():
                if there.get(name, version) != version:
                    raise InputError(
                        f"--cluster {self.address}: worker {worker} has {name} {there[name]}, here it is {version}; "
                        "install the same versions"
                    )


def _worker_count(client: Client) -> Callable[[], int]:
    """How many workers there are, at least one; asked once in COUNTED_S, for the answer names every one of them."""
    count, until = 1, -math.inf

    def counted() -> int:
        nonlocal count, until
        if time.monotonic() > until:
            count, until = max(1, len(client.nthreads())), time.monotonic() + COUNTED_S
        return count

    return counted


def run_on(
    client: Client, task: Callable[[Item], Result], items: Iterable[Item], at_once: Callable[[], int]
) -> Generator[Outcome[Item, Result]]:
    """Run tasks on a cluster, `at_once()` of them at a time. Raises RunError where the scheduler goes away."""
    waiting = enumerate(items)
    pending: dict[Future[Any], tuple[int, Item]] = {}
    failures: dict[int, int] = {}
    finished = as_completed()

    def submit(number: int, item: Item) -> None:
        future = client.submit(_try, task, item, pure=False, priority=-number)
        pending[future] = (number, item)
        finished.add(future)

    def fill() -> None:
        while len(pending) < at_once():
            following = next(waiting, None)
            if following is None:
                return
            submit(*following)

    try:
        fill()
        while pending:
            future = next(finished)
            number, item = pending.pop(future)
            if future.status not in ("finished", "error"):
                raise RunError(GONE)
            failed, tried = _read(future)
            before = failures.pop(number, 0)
            if failed and not tried.final and before + failed <= RETRIES:
                failures[number] = before + failed
                submit(number, item)
                continue
            yield Outcome(item, tried.result, tried.error, tried.seconds, before + max(failed - 1, 0))
            fill()
    finally:
        client.cancel(list(pending))


@dataclass(frozen=True)
class _Tried:
    """What one try gave, as it is sent back from a worker. final: whether another try would fail in the same way."""

    result: Any = None
    error: str | None = None
    seconds: float | None = None
    final: bool = False


def _try(task: Callable[[Item], Result], item: Item) -> _Tried:
    """Run a task in a worker. Its error is sent back as text: not every exception survives the way."""
    began, final = time.monotonic(), False
    try:
        result, error = task(item), None
    except Exception as raised:
        # The tool's own errors, such as a TrafficError, come again with the same scenario and seed.
        result, error, final = None, describe(raised), isinstance(raised, (RunError, InputError))
    return _Tried(result, error, round(time.monotonic() - began, 3), final)


def _read(future: Future[Any]) -> tuple[int, _Tried]:
    """How many tries failed since the task was handed over, and what the last one gave."""
    if future.status == "finished":
        tried: _Tried = future.result()
        return int(tried.error is not None), tried
    error = future.exception()
    if isinstance(error, KilledWorker):
        # A scheduler of others may have tried again by itself before it told.
        return error.allowed_failures + 1, _Tried(error="the worker process died")
    return 1, _Tried(error=describe(error))


def describe(error: BaseException | None) -> str:
    """An error in one line: the plain message of the tool's own, the kind and message of others."""
    text = str(error) if isinstance(error, (RunError, InputError)) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())[:500]
