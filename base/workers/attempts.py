"""One try of a task in a worker process, and what becomes of its item after as many as are allowed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.shortages import hidden_shortage, shortage

Item = TypeVar("Item")
Result = TypeVar("Result")

RETRIES = 2
"""How often a task is retried after it failed or its worker died."""
DIED = "the worker process died"
"""How the error of a try begins that ended with its process."""


@dataclass(frozen=True)
class Attempt:
    """One try of a task, as a worker sends it back.

    result: what the task returned. error: why it failed, in one line. seconds: how long it took. final: another try
    would fail in the same way. stop: the error that ends the whole command, if no try is left. printed: what libraries
    printed meanwhile.
    """

    result: Any = None
    error: str | None = None
    seconds: float | None = None
    final: bool = False
    stop: RunError | InputError | None = None
    printed: str = ""


@dataclass(frozen=True)
class Outcome(Generic[Item, Result]):
    """What became of one item.

    result: what the task returned, None if it failed. error: the error of the last try in one line, None if it
    succeeded. seconds: duration of the last try, None if its worker died. retries: tries before the last one. printed:
    what libraries printed during the last try, SUMO's own messages included.
    """

    item: Item
    result: Result | None = None
    error: str | None = None
    seconds: float | None = None
    retries: int = 0
    printed: str = ""


@dataclass
class Tries(Generic[Item]):
    """An item that is being worked on, and how many tries of it have failed."""

    item: Item
    failed: int = 0

    def outcome(self, attempt: Attempt) -> Outcome[Item, Any] | None:
        """Return what becomes of the item after a try, None if there is another try. Raises what ends the command."""
        if attempt.error is not None and not attempt.final and self.failed < RETRIES:
            self.failed += 1
            return None
        if attempt.stop is not None:
            raise attempt.stop
        return Outcome(self.item, attempt.result, attempt.error, attempt.seconds, self.failed, attempt.printed)


def try_task(task: Callable[[Item], Result], item: Item, output: Path | None = None) -> Attempt:
    """Run a task. Errors come back as text, because not every exception can be sent to another process.

    output: the folder that the command writes, if it is known.
    """
    begin = time.monotonic()
    try:
        attempt = Attempt(task(item))
    except Exception as error:
        attempt = failed(error, output)
    return replace(attempt, seconds=round(time.monotonic() - begin, 3))


def describe(error: BaseException | None) -> str:
    """Return an error in one line: the plain message of our own errors, the type and message of all others."""
    text = str(error) if isinstance(error, (RunError, InputError)) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())[:500]


def failed(error: Exception, output: Path | None) -> Attempt:
    """Return the try that an error ended. output: the folder that the command writes, if it is known."""
    stop: RunError | InputError | None = shortage(error, output) or hidden_shortage()
    if stop is None and isinstance(error, InputError):
        stop = error
    # Our own errors, such as a TrafficError, come again with the same scenario and seed.
    final = stop is not None or isinstance(error, RunError)
    return Attempt(error=describe(error), final=final, stop=_bare(stop))


def _bare(error: RunError | InputError | None) -> RunError | InputError | None:
    """Return an error without what else was raised on its way, which may not be pickled."""
    if error is None:
        return None
    error.__context__ = error.__cause__ = None
    return error.with_traceback(None)
