"""Worker processes, started once for all tests of this package."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass

import pytest
from distributed import Client

from labeling.generation.engine import Item, LocalEngine, Outcome, Result, run_on


@dataclass(frozen=True)
class KeptEngine:
    """Runs tasks on worker processes that are already running. workers: how many tasks run at the same time."""

    client: Client
    workers: int

    def run(self, task: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Outcome[Item, Result]]:
        return run_on(self.client, task, items, lambda: self.workers)


@pytest.fixture(scope="package")
def client() -> Iterator[Client]:
    """Two worker processes, for tests that are not about how these start and end."""
    with LocalEngine(2).started() as client:
        yield client


@pytest.fixture
def one_worker(client: Client) -> KeptEngine:
    return KeptEngine(client, 1)


@pytest.fixture
def two_workers(client: Client) -> KeptEngine:
    return KeptEngine(client, 2)
