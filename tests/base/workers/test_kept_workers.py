"""Worker processes that are kept: one start for several runs, none without work, and every task is run."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import pytest

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import KeptWorkers, kept_running
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


def test_tasks_of_several_threads_leave_workers_idle(two_workers: KeptWorkers) -> None:
    """An item is taken only when there is a worker for each of its threads, or nothing else runs."""
    for threads, at_once in ((1, 2), (2, 1), (5, 1)):
        taken: list[int] = []
        items = (taken.append(k) or k for k in range(4))
        with closing(two_workers.run(process_of, items, threads)) as outcomes:
            next(outcomes)
            assert len(taken) == at_once
            assert len(list(outcomes)) == 3


def dying_at_once(folder: Path) -> int:
    """End the process the first time, return the second time."""
    runs = len(list(folder.iterdir()))
    (folder / str(runs)).touch()
    if not runs:
        os._exit(1)
    return runs


@pytest.mark.slow
def test_a_replacement_may_start_slowly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a busy machine."""
    (tmp_path / "sitecustomize.py").write_text(
        f"import pathlib, time\nif any(pathlib.Path({str(tmp_path / 'runs')!r}).iterdir()): time.sleep(25)\n"
    )
    (tmp_path / "runs").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (outcome,) = LocalEngine(1).run(dying_at_once, [tmp_path / "runs"])
    assert (outcome.result, outcome.retries) == (1, 1)
