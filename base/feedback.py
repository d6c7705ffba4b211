"""How long work reports to the person who waits for it: messages, details and progress bars."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Move(Protocol):
    """Moves a progress bar."""

    def __call__(self, done: float, total: float, note: str = "") -> None:
        """Show that `done` of `total` units are finished, and a short note beside the bar."""


class Feedback:
    """Receives the reports of long work. This base class discards them; the command line shows them on a console."""

    def message(self, line: str) -> None:
        """Report something that everyone should see."""

    def detail(self, line: str) -> None:
        """Report something for those who ask for details."""

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        """Show a progress bar with the time left for the duration of the block; yield the function that moves it.

        title: what is being done, "sensing". unit: what is counted, "records"; without it the bar shows a percentage.
        """
        yield _ignore_move


def _ignore_move(done: float, total: float, note: str = "") -> None:
    """Move nothing."""


SILENT = Feedback()
