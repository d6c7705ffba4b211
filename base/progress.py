"""Progress bars and messages on a console."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from isac_cosim.base.feedback import Feedback, Move

UNBOUND = 1000
"""Wider than any table, characters."""
SPEED_S = 300.0
"""The time left is estimated from the speed over this time, s."""


@dataclass(frozen=True)
class ConsoleFeedback(Feedback):
    """Draws bars and prints messages; details only where they are asked for."""

    console: Console
    verbose: bool = False

    def message(self, line: str) -> None:
        print_line(self.console, line)

    def detail(self, line: str) -> None:
        if self.verbose:
            print_line(self.console, line)

    @contextmanager
    def bar(self, title: str, unit: str = "") -> Iterator[Move]:
        counts: list[ProgressColumn] = [MofNCompleteColumn(), TextColumn(unit)]
        share: list[ProgressColumn] = [TextColumn("{task.percentage:3.0f} %")]
        progress = Progress(
            TextColumn(title),
            BarColumn(),
            *(counts if unit else share),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self.console,
            speed_estimate_period=SPEED_S,
        )
        task = progress.add_task("", start=False, total=None, note="")

        def move(done: float, total: float, note: str = "") -> None:
            if not progress.live.is_started:
                # Drawn from the first move on: what is refused before any work begins shows no bar. What was done
                # before that is no measure of this command's speed.
                progress.start()
                progress.reset(task, total=total, completed=int(done))
            progress.update(task, completed=done, total=total, note=note)

        try:
            yield move
        finally:
            if progress.live.is_started:
                progress.stop()


def print_line(console: Console, line: str) -> None:
    """Print a line as it is: not wrapped, and without markup."""
    console.print(line, highlight=False, soft_wrap=True, markup=False)
