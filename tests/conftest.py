"""Made-up records, predictors trained on them once a session, worker processes, and a single thread for torch."""

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.base.workers.pool import WorkerPool
from isac_cosim.base.workers.threads import torch_threads
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records

# No test depends on how fast the machine is.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.fixture(scope="session")
def records() -> Records:
    """224 records of 8 seeds."""
    return make_records()


@pytest.fixture(scope="session")
def network_run(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A small ASI-BIP, trained for three epochs."""
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "network", SMALL_RUN)


@pytest.fixture(scope="session")
def trees_run(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Boosted trees on the same windows."""
    settings = SMALL_RUN.model_copy(update={"model": "trees"})
    return train_records(records, MADE_OF, tmp_path_factory.mktemp("runs") / "trees", settings)


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Small batches of torch lose more by sharing a thread pool than they gain."""
    with torch_threads(1):
        yield


@pytest.fixture(scope="session")
def pool() -> Iterator[WorkerPool]:
    """Worker processes for tests that are not about how these start and end."""
    with LocalEngine(2).started() as pool:
        yield pool


@pytest.fixture
def one_worker(pool: WorkerPool) -> KeptWorkers:
    return KeptWorkers(lambda: pool, 1, 1)


@pytest.fixture
def two_workers(pool: WorkerPool) -> KeptWorkers:
    return KeptWorkers(lambda: pool, 2, 2)
