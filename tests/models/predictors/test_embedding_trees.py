"""Trees on the features of a network and on statistics."""

from pathlib import Path

import numpy as np

from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.predictors.trees import tree_features
from isac_cosim.models.runs.run import Run, load_run
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN


def test_the_trees_see_the_network_s_features_and_the_statistics(
    records: Records, network_run: Run, tmp_path: Path
) -> None:
    settings = SMALL_RUN.model_copy(update={"model": "embedding-trees"})
    run = load_run(train_records(records, MADE_OF, tmp_path / "run", settings).path)
    known = records.take(records.label < 6)
    ends = draw_ends(known, settings.windows, "test")
    windows = cut(known, ends, settings.windows)
    outputs, network = run.predictor(windows), network_run.predictor(windows)
    width = network.features.shape[1]
    np.testing.assert_allclose(outputs.features[:, :width], network.features, atol=1e-6)
    np.testing.assert_array_equal(outputs.features[:, width:], tree_features(windows, known.tv_rate_hz))
    assert (run.path / "weights.pt").read_bytes() == (network_run.path / "weights.pt").read_bytes()
    assert run.card.best_epoch == network_run.card.best_epoch
    probabilities = run.predictor.trees.predict_proba(outputs.features.astype(np.float32))
    np.testing.assert_allclose(outputs.probabilities, probabilities, atol=1e-9)
    assert (outputs.logits.argmax(axis=1) == known.label[ends.row]).mean() > 0.6
