"""Worker processes that serve one run of tasks after the other, so that none waits for new ones to start."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property

from isac_cosim.base.workers.attempts import Item, Outcome, Result
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.pool import WorkerPool


@contextmanager
def kept_running(engine: Engine) -> Iterator[Engine]:
    """Yield an engine like the given one, whose worker processes run from their first use until the block ends.

    A worker of a `LocalEngine` takes seconds to start, most of them for imports; other engines are yielded unchanged.
    """
    with ExitStack() as stack:
        if isinstance(engine, LocalEngine):
            yield KeptWorkers(lambda: stack.enter_context(engine.started()), engine.workers, engine.cores)
        else:
            yield engine


class KeptWorkers:
    """An engine on worker processes that somebody else ends.

    start: returns the processes; called with the first tasks. workers: how many tasks run at a time. cores: how many
    processor cores they share.
    """

    def __init__(self, start: Callable[[], WorkerPool], workers: int, cores: int) -> None:
        self._start, self._workers, self._cores = start, workers, cores

    @property
    def workers(self) -> int:
        return self._workers

    @property
    def cores(self) -> int:
        return self._cores

    def run(
        self, task: Callable[[Item], Result], items: Iterable[Item], threads: int = 1
    ) -> Generator[Outcome[Item, Result]]:
        yield from self._pool.run(task, items, self.workers // threads)

    @cached_property
    def _pool(self) -> WorkerPool:
        return self._start()
