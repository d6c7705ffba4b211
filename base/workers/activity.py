"""What this process is doing, told to the one who watches it: a crash in C++ leaves no error behind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Reading:
    """The user's input that SUMO reads. what: "scenario road, seed 1"."""

    what: str
    files: tuple[str, ...]


_listeners: list[Callable[[Reading | None], None]] = []


def tell(listener: Callable[[Reading | None], None]) -> None:
    """Call a function when SUMO begins to read input in this process, and with None when it has read it."""
    _listeners[:] = [listener]


@contextmanager
def reading(what: str, files: Iterable[Path]) -> Iterator[None]:
    """Say that SUMO reads the user's input inside the block: if the process dies there, the input is at fault."""
    for listener in _listeners:
        listener(Reading(what, tuple(map(str, files))))
    try:
        yield
    finally:
        for listener in _listeners:
            listener(None)
