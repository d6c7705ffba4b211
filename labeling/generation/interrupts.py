"""Ctrl-C is handled by the command alone, which then ends its worker processes; nobody else prints anything.

A terminal sends the interrupt to every process of a command. Each worker that received it would print a traceback.
"""

from __future__ import annotations

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deferred() -> Iterator[None]:
    """Delay Ctrl-C until the block ends, and hide it from the threads and processes that are started inside.

    They inherit the blocked signal for life, and so do the processes that those threads start later.
    On Windows, which has no signal masks, nothing is delayed and `dask_setup` alone protects the workers.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def silence_asyncio() -> None:
    """Keep asyncio from printing the errors of tasks that dask abandons when it shuts down."""
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)


def dask_setup(worker: object) -> None:
    """Make a worker process ignore Ctrl-C. dask calls this function because the module is a worker's preload."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    silence_asyncio()
