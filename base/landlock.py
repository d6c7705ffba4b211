"""Threads that can write nowhere but in a temporary folder of their own: a wall of the kernel's around SUMO.

SUMO runs in such a thread. Whatever its input files make it do, the kernel refuses to create, change or remove any
other file, and to open TCP connections. Linux offers this as Landlock, to every process and without privileges
(https://docs.kernel.org/userspace-api/landlock.html). It binds a thread and what the thread starts, for good, so each
task gets a new thread. Where the kernel has no Landlock, tasks run as they are.
"""

from __future__ import annotations

import contextvars
import ctypes
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import cache
from pathlib import Path
from typing import TypeVar

from isac_cosim.base.errors import RunError
from isac_cosim.base.temporary import TemporaryFolder

Result = TypeVar("Result")

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Numbers of the system calls, the same on every architecture."""
VERSION_FLAG, PATH_BENEATH = 1, 1
NO_NEW_PRIVILEGES = 38
"""Of prctl. A thread without privileges has to promise that it never gets any, before it may restrict itself."""
WRITE_FILE = 1 << 1
CHANGE_FILES = sum(1 << bit for bit in range(4, 13))
"""Removing and making files, folders, links, sockets, pipes and devices."""
REFER, TRUNCATE = 1 << 13, 1 << 14
TCP = 0b11
"""To wait for connections, and to open them."""


class _Ruleset(ctypes.Structure):
    """The rights that a ruleset takes away, unless a rule grants them: on files, and on the network."""

    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    """A rule that grants rights on a file, or on everything in a folder."""

    _pack_ = 1
    _fields_ = (("rights", ctypes.c_uint64), ("descriptor", ctypes.c_int32))


@cache
def version() -> int:
    """Return the version of Landlock's interface that the kernel offers, 0 where it has none."""
    if sys.platform != "linux":
        return 0
    try:
        return max(0, _call(CREATE_RULESET, None, 0, VERSION_FLAG))
    except OSError:
        return 0


_here = threading.local()


def folder() -> Path | None:
    """Return the one folder in which this thread can write, None where it can write as its process can."""
    found: Path | None = getattr(_here, "folder", None)
    return found


def confined(task: Callable[[], Result]) -> Result:
    """Return what a task returns. Meanwhile, the task can write in `folder()` alone, which is removed afterwards.

    The task runs as it is where the kernel has no Landlock, or this thread is confined already. A signal that ends the
    waiting thread, such as Ctrl-C, ends the task too. Raises what the task raises.
    """
    if not version() or folder() is not None:
        return task()
    future: Future[Result] = Future()
    context = contextvars.copy_context()

    def run() -> None:
        try:
            _confine(temporary.path)
            future.set_result(context.run(task))
        except BaseException as error:
            future.set_exception(error)

    with TemporaryFolder() as temporary:
        thread = threading.Thread(target=run, name="confined", daemon=True)
        try:
            thread.start()
            wait([future])  # `thread.join` takes the thread for ended when it is interrupted
        except BaseException:
            if thread.ident is not None:  # it has begun
                _interrupt(thread.ident)
                wait([future])
            raise
    return future.result()


def _confine(writable: Path) -> None:
    """Take from this thread, for good, the right to change files outside a folder, and the network's TCP."""
    offered = version()
    files = WRITE_FILE | CHANGE_FILES | (REFER if offered >= 2 else 0) | (TRUNCATE if offered >= 3 else 0)
    rules = _Ruleset(files, TCP)
    ruleset = _call(CREATE_RULESET, ctypes.byref(rules), ctypes.sizeof(rules) if offered >= 4 else 8, 0)
    try:
        for path, rights in ((writable, files), (Path(os.devnull), files & (WRITE_FILE | TRUNCATE))):
            descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
            try:
                _call(ADD_RULE, ruleset, PATH_BENEATH, ctypes.byref(_Beneath(rights, descriptor)), 0)
            finally:
                os.close(descriptor)
        if _c_library().prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        _call(RESTRICT_SELF, ruleset, 0)
    except OSError as error:
        raise RunError(f"the kernel's Landlock does not confine the task ({error.strerror})") from None
    finally:
        os.close(ruleset)
    _here.folder = writable


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(number: int, *arguments: object) -> int:
    """Make a system call. Raises OSError."""
    result: int = _c_library().syscall(ctypes.c_long(number), *map(_as_wide, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def _as_wide(argument: object) -> object:
    """A number as the system call takes it; other arguments as they are."""
    return ctypes.c_ulong(argument) if isinstance(argument, int) else argument


def _interrupt(thread: int) -> None:
    """Have a thread raise KeyboardInterrupt at its next step."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt))
