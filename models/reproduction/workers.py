"""Worker processes that serve all stages of a reproduction, so that no stage waits for new ones to start."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from typing import TypeVar

from distributed import Client

from labeling.generation.engine import Engine, LocalEngine, Outcome, run_on

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def kept_running(engine: Engine) -> Iterator[Engine]:
    """Yield an engine like the given one, whose worker processes run from its first use until the block ends.

    A worker of a `LocalEngine` takes seconds to start, most of them for imports; other engines are yielded unchanged.
    """
    with ExitStack() as stack:
        yield KeptWorkers(engine, stack) if isinstance(engine, LocalEngine) else engine


class KeptWorkers:
    """An engine whose worker processes start when the first tasks come, and run until a stack of contexts is closed."""

    def __init__(self, engine: LocalEngine, stack: ExitStack) -> None:
        self._engine, self._stack = engine, stack

    @property
    def workers(self) -> int:
        return self._engine.workers

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        yield from run_on(self._client, task, items, lambda: self.workers)

    @cached_property
    def _client(self) -> Client:
        return self._stack.enter_context(self._engine.started())
