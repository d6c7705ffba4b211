"""Signals that end a command: the command alone handles them, and ends its worker processes. One line is printed.

A terminal and a batch system send such signals to every process of a command. Each worker that received Ctrl-C would
print a traceback.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C; what `kill` and batch systems send; what a terminal sends when it is closed."""
AGAIN_S = 0.02
"""How long until a signal that Python dropped is sent again, s."""
_received: list[int] = []


@contextmanager
def raised_alike() -> Iterator[None]:
    """Let each of these signals raise KeyboardInterrupt inside the block, as Ctrl-C does.

    A signal that is ignored stays so, as SIGHUP is under `nohup`.
    """
    _received.clear()
    if not _in_main_thread():
        yield
        return
    # None stands for a handler that is not Python's own.
    taken = [number for number in ENDING if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, _interrupt) for number in taken}
    hook, repeats = sys.unraisablehook, list[threading.Timer]()

    def repeat(lost: Any) -> None:
        # Python drops what is raised while it deletes an object: send the signal once more, a moment later.
        if lost.exc_type is not KeyboardInterrupt or not _received:
            hook(lost)
            return
        repeats.append(threading.Timer(AGAIN_S, _send, _received[:1]))
        repeats[-1].daemon = True
        repeats[-1].start()

    sys.unraisablehook = repeat
    try:
        yield
    finally:
        sys.unraisablehook = hook
        with suppress(KeyboardInterrupt):
            for timer in repeats:
                timer.cancel()
                timer.join()
        for number, handler in before.items():
            signal.signal(number, handler)


def received() -> int | None:
    """Return the signal that arrived first since the last `raised_alike` began, None if there was none."""
    return _received[0] if _received else None


@contextmanager
def deferred() -> Iterator[None]:
    """Delay these signals until the block ends, and hide Ctrl-C from the processes that are started inside."""
    if not _in_main_thread():
        yield
        return
    arrived: list[int] = []
    taken = [number for number in ENDING if signal.getsignal(number) is not None]
    before = {number: signal.signal(number, lambda number, _: arrived.append(number)) for number in taken}
    try:
        with _blocked():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if arrived:
        signal.raise_signal(arrived[0])


def _interrupt(number: int, _: FrameType | None) -> None:
    _received.append(number)
    raise KeyboardInterrupt


def _send(number: int) -> None:
    """Send a signal to the main thread, which it wakes."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        signal.raise_signal(number)


def _in_main_thread() -> bool:
    """Whether this is the thread that receives signals."""
    return threading.current_thread() is threading.main_thread()


@contextmanager
def _blocked() -> Iterator[None]:
    """Block Ctrl-C in this thread and in the processes that are started inside, until they ignore it themselves.

    Windows has no signal masks.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # of POSIX

    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        # Multiprocessing's own process inherits the blocked signals; when it starts, it unblocks some of them here.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_SETMASK, {*before, signal.SIGINT})
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
