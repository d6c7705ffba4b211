"""Runs what is missing, one item after the other, under a progress bar: all work that goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.workers.attempts import Item, Outcome, Result
from isac_cosim.base.workers.engine import Engine


@dataclass
class Tally:
    """Counts what is finished. total: how much there is."""

    total: float
    done: float = 0

    def __call__(self) -> tuple[float, float]:
        """Return how much is finished, and how much there is."""
        return self.done, self.total


def run_missing(
    task: Callable[[Item], Result],
    missing: Iterable[Item],
    engine: Engine,
    feedback: Feedback,
    *,
    title: str,
    unit: str,
    keep: Callable[[Outcome[Item, Result]], object],
    progress: Callable[[], tuple[float, float]],
    enough: Callable[[], bool] = lambda: False,
    threads: int = 1,
) -> None:
    """Run a task for the items that are not finished yet.

    title, unit: of the progress bar. keep: called with what became of each item, in the order in which they finish; if
    it raises, the running tasks end. progress: how much is finished, and how much there is. enough: whether the rest is
    no longer needed. threads: that a task uses.
    Raises what `Engine.run` and `keep` raise.
    """
    with feedback.bar(title, unit) as move, closing(engine.run(task, missing, threads)) as outcomes:
        move(*progress())
        for outcome in outcomes:
            keep(outcome)
            move(*progress())
            if enough():
                return
