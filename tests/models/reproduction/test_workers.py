"""Worker processes that are kept: one start for several runs, none without work, and every task is run."""

from __future__ import annotations

import os

from labeling.generation.engine import LocalEngine
from models.reproduction.workers import KeptWorkers, kept_running
from tests.support.scripted import InlineEngine


def process_of(item: int) -> tuple[int, int]:
    return item, os.getpid()


def test_one_process_serves_every_run_until_the_block_ends() -> None:
    with kept_running(LocalEngine(1)) as workers:
        assert workers.workers == 1
        outcomes = [outcome for part in ([1, 2], [3]) for outcome in workers.run(process_of, part)]
    results = [outcome.result for outcome in outcomes if outcome.result is not None]
    assert [item for item, _ in results] == [1, 2, 3]
    (process,) = {process for _, process in results}
    assert process != os.getpid()


def test_no_process_starts_without_a_run() -> None:
    class Refusing(LocalEngine):
        def run(self, *_: object) -> None:  # type: ignore[override]
            raise AssertionError

        def started(self) -> None:  # type: ignore[override]
            raise AssertionError

    with kept_running(Refusing(2)) as workers:
        assert isinstance(workers, KeptWorkers)
        assert workers.workers == 2


def test_other_engines_are_left_alone() -> None:
    engine = InlineEngine()
    with kept_running(engine) as workers:
        assert workers is engine
