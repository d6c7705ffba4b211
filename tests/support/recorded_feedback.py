"""Feedback that tests can read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from isac_cosim.base.feedback import Feedback, Move


@dataclass
class RecordedFeedback(Feedback):
    """Keeps all reports: messages, details, and the moves (done, total) of all bars in their order.

    on_move: also called with every move.
    """

    messages: list[str] = field(default_factory=list)
    details: list[str] = field(default_factory=list)
    moves: list[tuple[float, float]] = field(default_factory=list)
    on_move: Callable[[float, float], None] = lambda done, total: None

    def message(self, line: str) -> None:
        self.messages.append(line)

    def detail(self, line: str) -> None:
        self.details.append(line)

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        def move(done: float, total: float, note: str = "") -> None:
            self.moves.append((done, total))
            self.on_move(done, total)

        yield move
