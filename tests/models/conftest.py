"""Made-up records, and predictors trained on them once a session."""

import pytest

from models.data.windows import Records
from models.run import Run
from models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records


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
