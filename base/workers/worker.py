"""What runs in a worker process: one task after the other, as long as the command that started it lives.

`serve` is the entry of every worker process of this machine. There it is known where the process may write.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path

from isac_cosim.base.temporary import keep_temporary_files_in
from isac_cosim.base.workers import activity
from isac_cosim.base.workers.attempts import Attempt, failed, try_task

MESSAGES_FILE = "messages"
"""In a worker's folder: what libraries print there."""
LONGEST = 2000
"""Longest text that is kept of what libraries print, characters."""


@dataclass(frozen=True)
class Workplace:
    """Where a worker process may write.

    own: the folder of its temporary files, deleted when it has ended. told: the folder for temporary files that the
    user knows, in which `own` lies. output: the folder that the command writes, if it is known.
    """

    own: Path
    told: Path
    output: Path | None


@dataclass(frozen=True)
class Ready:
    """Sent by a worker process that has started. Later it sends a `Reading`, or None, and each `Attempt`."""


def serve(connection: Connection, workplace: Workplace) -> None:
    """Run the tasks that come through a connection, and send back an `Attempt` for each. The entry of a process."""
    _end_with_parent()
    messages = _Messages(workplace.own / MESSAGES_FILE)
    # Ctrl-C reaches every process of a terminal's command; the command itself decides what becomes of its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    keep_temporary_files_in(workplace.own, workplace.told)
    activity.tell(connection.send)
    connection.send(Ready())
    with suppress(EOFError):  # the command needs no more workers
        while True:
            attempt = _run(connection.recv_bytes(), workplace.output)
            _send(connection, replace(attempt, printed=messages.taken()))


def _run(content: bytes, output: Path | None) -> Attempt:
    """Run a task and its item, which come pickled."""
    try:
        task, item = pickle.loads(content)
    except Exception as error:
        return failed(error, output)
    return try_task(task, item, output)


def _send(connection: Connection, attempt: Attempt) -> None:
    try:
        content = pickle.dumps(attempt)
    except Exception as error:
        content = pickle.dumps(replace(failed(error, None), seconds=attempt.seconds, printed=attempt.printed))
    connection.send_bytes(content)


class _Messages:
    """The file that takes what this process prints, SUMO included, instead of the terminal."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("a+b")
        for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
            with suppress(AttributeError, OSError, ValueError):  # a process without a terminal may have none
                stream.flush()
            os.dup2(self._file.fileno(), number)

    def taken(self) -> str:
        """Return the end of what was printed since the last call, and forget it."""
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):
                stream.flush()
        text = last_words(self._file.fileno())
        self._file.truncate(0)
        return text


def last_words(file: int | Path) -> str:
    """Return the end of a file of messages; nothing if it cannot be read."""
    with suppress(OSError), open(file, "rb", closefd=isinstance(file, Path)) as content:
        length = content.seek(0, os.SEEK_END)
        content.seek(max(0, length - LONGEST))
        return content.read().decode(errors="replace").strip()
    return ""


def _end_with_parent() -> None:
    """End this process as soon as the command that started it has ended, however that ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    _have_the_kernel_watch(parent.sentinel)

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, name="end with parent", daemon=True).start()


def _have_the_kernel_watch(sentinel: int) -> None:
    """Have the kernel kill this process when the other end of a pipe is closed, on systems that can.

    A thread alone is not enough: it does not run while C++ code, such as SUMO's, keeps Python's global lock.
    """
    if not sys.platform.startswith("linux"):
        return
    import fcntl

    with suppress(OSError):
        fcntl.fcntl(sentinel, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(sentinel, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(sentinel, fcntl.F_SETFL, fcntl.fcntl(sentinel, fcntl.F_GETFL) | os.O_ASYNC)
