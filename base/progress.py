"""Progress and messages on a console: bars on a terminal, lines anywhere else."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.text import Text

from isac_cosim.base.feedback import Feedback, Move, spoken_time

UNBOUND = 1000
"""Wider than any table, characters."""
SPEED_S = 300.0
"""The time left is estimated from the speed over this time, or over the last move where that took longer, s."""
LINE_S = 60.0
"""Where no bar can be drawn, lines that say how far the work is are at least this long apart, s."""


@dataclass
class Pace:
    """How fast work goes on, from its last moves."""

    moves: deque[tuple[float, float]] = field(default_factory=deque)

    def moved(self, done: float, now_s: float) -> None:
        """Take note that so much is done now. The first call says where the work begins."""
        if self.moves and done == self.moves[-1][1]:
            return
        self.moves.append((now_s, done))
        while len(self.moves) > 2 and self.moves[1][0] <= now_s - SPEED_S:
            self.moves.popleft()

    def left_s(self, total: float, now_s: float) -> float | None:
        """Return the seconds that are left until `total` is done, or None before anything was done."""
        if len(self.moves) < 2:
            return None
        (began_s, before), (moved_s, done) = self.moves[0], self.moves[-1]
        ends_s = moved_s + (total - done) * (moved_s - began_s) / (done - before)
        return max(ends_s - now_s, 0.0)


@dataclass(frozen=True)
class ConsoleFeedback(Feedback):
    """Draws bars on a terminal, writes lines elsewhere, and prints messages; details only where they are asked for."""

    console: Console
    verbose: bool = False

    def message(self, line: str) -> None:
        print_line(self.console, line)

    def detail(self, line: str) -> None:
        if self.verbose:
            print_line(self.console, line)

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        if not self.console.is_terminal or self.console.is_dumb_terminal:
            lines = _Lines(self.console, title, unit)
            try:
                yield lines.move
            finally:
                lines.end()
            return
        counts: list[ProgressColumn] = [MofNCompleteColumn(), TextColumn(unit)]
        share: list[ProgressColumn] = [TextColumn("{task.percentage:3.0f} %")]
        pace = Pace()
        progress = Progress(
            TextColumn(title),
            BarColumn(),
            *(counts if unit else share),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            _TimeLeft(pace),
            console=self.console,
        )
        task = progress.add_task("", start=False, total=None, note="")

        def move(done: float, total: float, note: str = "") -> None:
            if not progress.live.is_started:
                # Drawn from the first move on: what is refused before any work begins shows no bar. What was done
                # before that is no measure of this command's speed.
                progress.start()
                progress.reset(task, total=total, completed=int(done))
            pace.moved(done, time.monotonic())
            progress.update(task, completed=done, total=total, note=note)

        try:
            yield move
        finally:
            if progress.live.is_started:
                progress.stop()


class _Lines:
    """Says in lines how far work is: when it begins, at most every LINE_S, and when it ends."""

    def __init__(self, console: Console, title: str, unit: str) -> None:
        self._console, self._title, self._unit = console, title, unit
        self._pace = Pace()
        self._began_s: float | None = None
        self._said_s = -math.inf
        self._line = self._said = ""

    def move(self, done: float, total: float, note: str = "") -> None:
        """Say where the work is, if nothing was said for long."""
        now_s = time.monotonic()
        self._pace.moved(done, now_s)
        left_s = self._pace.left_s(total, now_s)
        took = "" if self._began_s is None else f"after {spoken_time(now_s - self._began_s)}"
        left = "" if not left_s else f"about {spoken_time(left_s)} left"
        count = f"{int(done)}/{int(total)} {self._unit}" if self._unit else f"{100 * done / (total or 1):.0f} %"
        self._line = f"{self._title}: {', '.join(part for part in (count, note, took, left) if part)}"
        if self._began_s is None:
            self._began_s = now_s
        if now_s - self._said_s >= LINE_S:
            self._say(now_s)

    def end(self) -> None:
        """Say how far the work came, unless that was said."""
        if self._line != self._said:
            self._say(time.monotonic())

    def _say(self, now_s: float) -> None:
        self._said, self._said_s = self._line, now_s
        print_line(self._console, self._line)


class _TimeLeft(ProgressColumn):
    """The time that is left, counting down between two moves."""

    max_refresh = 0.5

    def __init__(self, pace: Pace) -> None:
        super().__init__()
        self._pace = pace

    def render(self, task: Task) -> Text:
        left_s = None if task.total is None else self._pace.left_s(task.total, time.monotonic())
        return Text("-:--:--" if left_s is None else _clock(left_s), style="progress.remaining")


def _clock(seconds: float) -> str:
    """Write a duration as h:mm:ss."""
    return str(timedelta(seconds=round(seconds)))


def print_line(console: Console, line: str) -> None:
    """Print a line as it is: not wrapped, and without markup."""
    console.print(line, highlight=False, soft_wrap=True, markup=False)
