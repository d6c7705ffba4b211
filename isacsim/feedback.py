"""What long work tells the person who waits for it: messages, details and progress bars."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Move(Protocol):
    """Moves a progress bar."""

    def __call__(self, done: float, total: float, note: str = "") -> None:
        """Show that `done` of `total` is done, and a short note beside the bar."""


class Feedback:
    """Where long work reports to. This one reports nowhere; the command line's draws on a console."""

    def message(self, line: str) -> None:
        """Report something that everyone should see."""

    def detail(self, line: str) -> None:
        """Report something that only those want to see who ask for more."""

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        """Yield what moves a progress bar that shows the time left.

        title: what is being done, "sensing". unit: what is counted, "records"; without one the bar shows a percentage.
        """
        yield _stand_still


def _stand_still(done: float, total: float, note: str = "") -> None:
    """Move nothing."""


SILENT = Feedback()
