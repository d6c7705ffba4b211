"""How long work reports to the person who waits for it: messages, details and progress bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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


class Foreword(Feedback):
    """Says some lines before the first report of the work, and not where the work is refused before it begins.

    feedback: to whom all reports go. lines: what is said. say: how; as a message of the feedback unless given.
    """

    def __init__(self, feedback: Feedback, lines: Sequence[str], say: Callable[[str], object] | None = None) -> None:
        self._feedback = feedback
        self._lines = list(lines)
        self._say = say or feedback.message

    def say(self) -> None:
        """Say the lines, unless they were said already: for work that ends without a report."""
        lines, self._lines = self._lines, []
        for line in lines:
            self._say(line)

    def message(self, line: str) -> None:
        self.say()
        self._feedback.message(line)

    def detail(self, line: str) -> None:
        self.say()
        self._feedback.detail(line)

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        with self._feedback.bar(title, unit) as draw:

            def move(done: float, total: float, note: str = "") -> None:
                self.say()
                draw(done, total, note)

            yield move


def spoken_time(seconds: float) -> str:
    """Return a duration in the unit that suits it: `40 s`, `12 min`, `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _ignore_move(done: float, total: float, note: str = "") -> None:
    """Move nothing."""


SILENT = Feedback()
