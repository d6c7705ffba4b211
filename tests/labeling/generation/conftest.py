"""Worker processes, started once for all tests of this package."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from distributed import Client

from labeling.generation.engine import LocalEngine
from labeling.generation.kept_workers import KeptWorkers


@pytest.fixture(scope="package")
def client() -> Iterator[Client]:
    """Two worker processes, for tests that are not about how these start and end."""
    with LocalEngine(2).started() as client:
        yield client


@pytest.fixture
def one_worker(client: Client) -> KeptWorkers:
    return KeptWorkers(lambda: client, 1, 1)


@pytest.fixture
def two_workers(client: Client) -> KeptWorkers:
    return KeptWorkers(lambda: client, 2, 2)
