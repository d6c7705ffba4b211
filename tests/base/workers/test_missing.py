"""Work that goes on where it stopped: what is kept, the progress shown, and an early end."""

from collections.abc import Generator, Iterable
from typing import Any

import pytest

from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import SILENT
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.missing import Tally, run_missing
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine


class Watched(InlineEngine):
    """An engine that notes whether its tasks were ended."""

    ended = False

    def run(self, task: Any, items: Iterable[Any], threads: int = 1) -> Generator[Outcome[Any, Any]]:
        try:
            yield from super().run(task, items, threads)
        finally:
            self.ended = True


def test_the_bar_counts_from_what_was_finished_before() -> None:
    feedback, tally, kept = RecordedFeedback(), Tally(5, 2), []

    def keep(outcome: Outcome[int, int]) -> None:
        kept.append((outcome.item, outcome.result))
        tally.done += 1

    run_missing(
        lambda item: 10 * item, [3, 4, 5], InlineEngine(), feedback, title="doing", unit="things", keep=keep,
        progress=tally,
    )  # fmt: skip
    assert kept == [(3, 30), (4, 40), (5, 50)]
    assert feedback.moves == [(2, 5), (3, 5), (4, 5), (5, 5)]


def test_what_is_no_longer_needed_is_not_run() -> None:
    engine, kept, taken = Watched(), [], []

    def items() -> Generator[int]:
        for item in range(100):
            taken.append(item)
            yield item

    run_missing(
        str, items(), engine, SILENT, title="", unit="", keep=lambda outcome: kept.append(outcome.item),
        progress=Tally(100), enough=lambda: len(kept) == 3,
    )  # fmt: skip
    assert kept == taken == [0, 1, 2]
    assert engine.ended


def test_an_error_of_what_is_kept_ends_the_tasks() -> None:
    engine = Watched()

    def keep(outcome: Outcome[int, str]) -> None:
        raise RunError(f"item {outcome.item}")

    with pytest.raises(RunError, match="item 7"):
        run_missing(str, [7, 8], engine, SILENT, title="", unit="", keep=keep, progress=Tally(2))
    assert engine.ended
