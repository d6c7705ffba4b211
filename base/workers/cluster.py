"""Runs tasks on the workers of a dask scheduler that is already running, perhaps on many machines."""

# mypy: disable-error-code="no-untyped-call"
# distributed is typed in part only.
from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import CancelledError, Client, Future, KilledWorker, as_completed

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.versions import OF_DATASETS, OF_RUNS, versions
from isac_cosim.base.workers.attempts import RETRIES, Attempt, Item, Outcome, Result, Tries, describe, try_task
from isac_cosim.base.workers.engine import LocalEngine

ANSWER_S = 15.0
"""How long a running scheduler may take to answer, s."""

FIRST_WORKER_S = 15.0
"""How long a running scheduler may take to get its first worker, s."""

COUNT_AGE_S = 1.0
"""How old the known number of a cluster's workers may be, s."""

ENCRYPTED = ("tls://", "wss://")
"""How the addresses begin at which both sides show certificates."""

GONE = "the dask scheduler went away; start it, and the same command goes on from there"


@dataclass(frozen=True)
class ClusterEngine:
    """Runs tasks on the workers of a running dask scheduler.

    address: of the scheduler, like `tls://10.0.0.1:8786`. With TLS, the certificates are those of dask's configuration,
    `distributed.comm.tls`. Each worker must be a process of one thread, have the same package versions as this process,
    and share a file system with it. Workers may join and leave at any time. output: the folder that the command writes.
    All methods raise InputError if no scheduler or no suitable worker answers, RunError if the scheduler goes away.
    """

    address: str
    output: Path | None = None

    @property
    def encrypted(self) -> bool:
        """Whether both sides show certificates. Without, everyone who can connect can run code on the workers."""
        return self.address.startswith(ENCRYPTED)

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
            yield from self._run_on(client, task, items, lambda: workers() // threads)

    def _run_on(
        self, client: Client, task: Callable[[Item], Result], items: Iterable[Item], capacity: Callable[[], int]
    ) -> Generator[Outcome[Item, Result]]:
        """Do what `run` does. capacity: called to get the number of tasks to run at the same time; below 1, one runs.

        Why a worker of a cluster died, nobody knows: memory, or a crash of SUMO. A task whose workers die every time is
        therefore tried on this machine, where it shows.
        """
        remaining = enumerate(items)
        pending: dict[Future[Any], tuple[int, Tries[Item]]] = {}
        finished = as_completed(loop=client.loop)

        def submit(number: int, tries: Tries[Item]) -> None:
            future = client.submit(try_task, task, tries.item, self.output, pure=False, priority=-number)
            pending[future] = (number, tries)
            finished.add(future)

        def fill() -> None:
            while len(pending) < max(1, capacity()):
                numbered = next(remaining, None)
                if numbered is None:
                    return
                submit(numbered[0], Tries(numbered[1]))

        try:
            fill()
            while pending:
                future = next(finished)
                number, tries = pending.pop(future)
                try:
                    outcome = tries.outcome(_read(future))
                except KilledWorker as death:
                    # A scheduler that others configured may have retried by itself before it reported the death.
                    tries.failed += death.allowed_failures + 1
                    outcome = None
                if tries.failed > RETRIES:
                    yield from LocalEngine(1, self.output).run(task, [tries.item])
                elif outcome is None:
                    submit(number, tries)
                else:
                    yield outcome
                fill()
        finally:
            client.cancel(list(pending))

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        """Yield a client of the scheduler, whose workers have been checked."""
        for name in ("asyncio", "distributed"):  # their messages about a scheduler that goes away
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            client = Client(self.address, timeout=ANSWER_S)
        except Exception as error:  # a bad address raises whatever its parts make the library raise
            certificates = ", and the certificates of dask's configuration (distributed.comm.tls)"
            raise InputError(
                f"--cluster {self.address}: no dask scheduler answers ({describe(error)}); start one, or correct the "
                f"address (tls://HOST:PORT or tcp://HOST:PORT){certificates if self.encrypted else ''}"
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


def _read(future: Future[Any]) -> Attempt:
    """Return the outcome of a task.

    Waits where the worker died with a result that nobody had fetched: the scheduler then runs the task again.
    Raises KilledWorker where workers died as often as the scheduler allows, RunError if the scheduler went away.
    """
    try:
        attempt: Attempt = future.result()
    except CancelledError:
        raise RunError(GONE) from None
    except KilledWorker:
        raise
    except Exception as error:
        return Attempt(error=describe(error))
    return attempt
