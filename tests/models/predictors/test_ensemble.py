"""The ensemble of a network and trees."""

from pathlib import Path

import numpy as np

from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN


def test_the_answer_is_the_mean_of_both(records: Records, network_run: Run, trees_run: Run, tmp_path: Path) -> None:
    settings = SMALL_RUN.model_copy(update={"model": "ensemble"})
    run = load_run(train_records(records, MADE_OF, tmp_path / "run", settings).path)
    windows = cut(records, draw_ends(records, settings.windows, "test")[:20], settings.windows)
    mean, network, trees = (trained.predictor(windows) for trained in (run, network_run, trees_run))
    np.testing.assert_allclose(mean.probabilities, (network.probabilities + trees.probabilities) / 2, atol=1e-6)
    np.testing.assert_array_equal(mean.features, network.features)
    np.testing.assert_array_equal(run.reference[0], network_run.reference[0])
    assert run.card.best_epoch == network_run.card.best_epoch
    assert (run.path / "history.csv").read_bytes() == (network_run.path / "history.csv").read_bytes()
