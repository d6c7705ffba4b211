"""The execution engine: runs independent tasks on dask.distributed workers, one process each.

The workers belong to this command, or to a scheduler that is already running. The results are the same.
"""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import dask
from dask.system import cpu_count
from distributed import CancelledError, Client, Future, KilledWorker, LocalCluster, as_completed

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.versions import OF_DATASETS, OF_RUNS, versions
from isac_cosim.base.workers import interrupts

Item = TypeVar("Item")
Result = TypeVar("Result")

RETRIES = 2
"""How often a task is retried after it failed or its worker died."""

ANSWER_S = 15.0
"""How long a running scheduler may take to answer, s."""

FIRST_WORKER_S = 15.0
"""How long a running scheduler may take to get its first worker, s."""

COUNT_AGE_S = 1.0
"""How old the known number of a cluster's workers may be, s."""

WORKER_BACK = "30 days"
"""How long a worker process of this machine may take to be replaced after it died."""

GONE = "the dask scheduler went away; start it, and the same command goes on from there"

ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that set the number of threads of numerical libraries."""


@dataclass(frozen=True)
class Outcome(Generic[Item, Result]):
    """What became of one item.

    result: what the task returned, None if it failed. error: the error of the last try in one line, None if it
    succeeded. seconds: duration of the last try, None if its worker died. retries: tries before the last one.
    """

    item: Item
    result: Result | None = None
    error: str | None = None
    seconds: float | None = None
    retries: int = 0


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
        """


@dataclass(frozen=True)
class LocalEngine:
    """Runs tasks on `jobs` worker processes of this machine, and replaces a worker that dies.

    A worker has one thread, numerical libraries included, so that results do not depend on `jobs`.
    """

    jobs: int

    @property
    def workers(self) -> int:
        return self.jobs

    @property
    def cores(self) -> int:
        return min(self.jobs, cpu_count())

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        with self.started() as client:
            yield from run_on(client, task, items, lambda: self.jobs // threads)

    @contextmanager
    def started(self) -> Iterator[Client]:
        """Yield a client of the worker processes, which run until the block ends."""
        settings = {
            # A worker that died is replaced, but on a busy machine that can take minutes. By default, dask gives it up
            # after 15 s; without workers, tasks would wait forever.
            "distributed.deploy.lost-worker-timeout": WORKER_BACK,
            # Have every death of a worker reported; run_on counts them and retries.
            "distributed.scheduler.allowed-failures": 0,
            "distributed.scheduler.worker-saturation": 1.0,
            "distributed.worker.daemon": False,
            # Dask's own statistics, of which nothing is shown: they took a tenth of a worker's processor time.
            "distributed.worker.profile.enabled": False,
            "distributed.admin.tick.interval": "1s",
            "distributed.admin.system-monitor.interval": "10s",
            "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, "1"),
        }
        interrupts.silence_asyncio()
        with dask.config.set(settings), ExitStack() as stack:
            with interrupts.deferred():
                cluster = stack.enter_context(self._start())
            yield stack.enter_context(Client(cluster))

    def _start(self) -> LocalCluster:
        """Start the worker processes; start all of them again if one dies before it is ready."""
        failures = 0
        while True:
            try:
                return LocalCluster(
                    n_workers=self.jobs,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=None,
                    # Any free port, so that commands side by side do not warn about each other's.
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                    silence_logs=logging.CRITICAL,
                    # No limit: tasks of several threads leave workers idle, whose share of the memory they may use.
                    memory_limit=0,
                    preload=[interrupts.__name__],
                )
            except RuntimeError as error:
                failures += 1
                if failures > RETRIES:
                    raise RunError(f"the worker processes do not start ({describe(error)})") from None


@dataclass(frozen=True)
class ClusterEngine:
    """Runs tasks on the workers of a running dask scheduler.

    address: of the scheduler, like `tcp://10.0.0.1:8786`. Each worker must be a process of one thread, have the same
    package versions as this process, and share a file system with it. Workers may join and leave at any time.
    All methods raise InputError if no scheduler or no suitable worker answers, RunError if the scheduler goes away.
    """

    address: str

    @property
    def workers(self) -> int:
        with self._connected() as client:
            return _worker_count(client)()

    @property
    def cores(self) -> int:
        return self.workers

    def check(self) -> None:
        """Raise InputError if no scheduler or no suitable worker answers."""
        with self._connected():
            pass

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        with self._connected() as client:
            workers = _worker_count(client)
            yield from run_on(client, task, items, lambda: workers() // threads)

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        """Yield a client of the scheduler, whose workers have been checked."""
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            client = Client(self.address, timeout=ANSWER_S)
        except Exception as error:  # a bad address raises whatever its parts make the library raise
            raise InputError(
                f"--cluster {self.address}: no dask scheduler answers ({describe(error)}); start one, or correct the "
                "address (tcp://HOST:PORT)"
            ) from None
        try:
            with client:
                self._check(client)
                yield client
        except OSError:
            raise RunError(GONE) from None

    def _check(self, client: Client) -> None:
        """Raise InputError if the workers cannot run simulations as this process would."""
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError:
            raise InputError(f"--cluster {self.address}: the scheduler has no workers; start some") from None
        for worker, threads in client.nthreads().items():
            if threads != 1:
                raise InputError(
                    f"--cluster {self.address}: worker {worker} has {threads} threads, but a process can run only one "
                    "simulation at a time; start it with --nthreads 1"
                )
        packages = (*OF_DATASETS, *OF_RUNS)
        here = versions(packages)
        for worker, there in client.run(versions, packages, on_error="return").items():
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
    """Return a function that gives the number of workers, at least one.

    It asks the scheduler at most once in COUNT_AGE_S, because the answer lists every single worker.
    """
    count, valid_until = 1, -math.inf

    def current_count() -> int:
        nonlocal count, valid_until
        if time.monotonic() > valid_until:
            count, valid_until = max(1, len(client.nthreads())), time.monotonic() + COUNT_AGE_S
        return count

    return current_count


def run_on(
    client: Client, task: Callable[[Item], Result], items: Iterable[Item], capacity: Callable[[], int]
) -> Generator[Outcome[Item, Result]]:
    """Yield the outcomes of tasks on a cluster, in the order in which they finish.

    capacity: called to get the number of tasks to run at the same time; below 1, one runs.
    Raises RunError if the scheduler goes away.
    """
    remaining = enumerate(items)
    pending: dict[Future[Any], tuple[int, Item]] = {}
    failures: dict[int, int] = {}
    finished = as_completed(loop=client.loop)

    def submit(number: int, item: Item) -> None:
        future = client.submit(_try, task, item, pure=False, priority=-number)
        pending[future] = (number, item)
        finished.add(future)

    def fill() -> None:
        while len(pending) < max(1, capacity()):
            numbered = next(remaining, None)
            if numbered is None:
                return
            submit(*numbered)

    try:
        fill()
        while pending:
            future = next(finished)
            number, item = pending.pop(future)
            try:
                new_failures, attempt = _read(future)
            except CancelledError:
                raise RunError(GONE) from None
            earlier_failures = failures.pop(number, 0)
            if new_failures and not attempt.final and earlier_failures + new_failures <= RETRIES:
                failures[number] = earlier_failures + new_failures
                submit(number, item)
                continue
            retries = earlier_failures + max(new_failures - 1, 0)
            yield Outcome(item, attempt.result, attempt.error, attempt.seconds, retries)
            fill()
    finally:
        client.cancel(list(pending))


@dataclass(frozen=True)
class _Attempt:
    """The outcome of one try, as a worker sends it back. final: another try would fail in the same way."""

    result: Any = None
    error: str | None = None
    seconds: float | None = None
    final: bool = False


def _try(task: Callable[[Item], Result], item: Item) -> _Attempt:
    """Run a task in a worker. Return its error as text, because not every exception can be pickled."""
    begin, final = time.monotonic(), False
    try:
        result, error = _bare(task(item)), None
    except Exception as raised:
        # Our own errors, such as a TrafficError, come again with the same scenario and seed.
        result, error, final = None, describe(raised), isinstance(raised, (RunError, InputError))
    return _Attempt(result, error, round(time.monotonic() - begin, 3), final)


def _bare(result: Result) -> Result:
    """Return a result as it is; an error without what else was raised on its way, which may not be pickled."""
    if isinstance(result, BaseException):
        result.__context__ = result.__cause__ = None
        return result.with_traceback(None)
    return result


def _read(future: Future[Any]) -> tuple[int, _Attempt]:
    """Return how many tries failed since the task was submitted, and the outcome of the last one.

    Waits where the worker died with a result that nobody had fetched: the scheduler then runs the task again.
    Raises CancelledError if the scheduler went away.
    """
    try:
        attempt: _Attempt = future.result()
    except CancelledError:
        raise
    except KilledWorker as error:
        # A scheduler that others configured may have retried by itself before it reported the death.
        return error.allowed_failures + 1, _Attempt(error="the worker process died")
    except Exception as error:
        return 1, _Attempt(error=describe(error))
    return int(attempt.error is not None), attempt


def describe(error: BaseException | None) -> str:
    """Return an error in one line: the plain message of our own errors, the type and message of all others."""
    text = str(error) if isinstance(error, (RunError, InputError)) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())[:500]
