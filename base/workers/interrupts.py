"""Ctrl-C is handled by the command alone, which then ends its worker processes; nobody else prints anything.

A terminal sends the interrupt to every process of a command. Each worker that received it would print a traceback.
"""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deferred() -> Iterator[None]:
    """Delay Ctrl-C until the block ends, and hide it from the threads and processes that are started inside."""
    if threading.current_thread() is not threading.main_thread():  # which alone receives it
        yield
        return
    arrived: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: arrived.append(number))
    try:
        with _blocked():
            yield
    finally:
        signal.signal(signal.SIGINT, before)
    if arrived:
        signal.raise_signal(signal.SIGINT)


@contextmanager
def _blocked() -> Iterator[None]:
    """Block the signal in this thread and in the threads and processes that are started inside, for all their life.

    On Windows, which has no signal masks, `dask_setup` alone protects the worker processes.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # of POSIX

    # A thread that has to start multiprocessing's resource tracker would unblock the signal for itself.
    resource_tracker.ensure_running()
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
