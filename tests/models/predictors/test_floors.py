"""The statistics that the trees see, and the trees."""

from pathlib import Path

import numpy as np
import pytest

from models.data.windows import Records, Windows, WindowSettings, cut, draw_ends
from models.predictors.floors import STATISTICS, TreesSettings, fit_trees, statistics
from models.run import Run, TreesPredictor, load_run
from models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records


def test_statistics_by_hand() -> None:
    rng = np.random.default_rng(0)
    tv, uv = rng.normal(size=(2, 6, 90)).astype(np.float32), rng.normal(size=(2, 6, 30)).astype(np.float32)
    found = statistics(Windows(tv, uv))
    assert found.shape == (2, 12 * len(STATISTICS))
    for stream, states in ((0, tv), (1, uv)):
        for component in range(6):
            x = states[1, component].astype(np.float64)
            third = len(x) // 3
            expected = [
                x.mean(), x.std(), x.min(), x.max(), x[0], x[-1], np.polyfit(np.arange(len(x)), x, 1)[0],
                x[:third].mean(), x[third : 2 * third].mean(), x[2 * third :].mean(),
            ]  # fmt: skip
            at = (6 * stream + component) * len(STATISTICS)
            np.testing.assert_allclose(found[1, at : at + len(STATISTICS)], expected, atol=1e-5)


def test_trees_learn_the_made_up_intentions_and_repeat_themselves() -> None:
    records = make_records(6, 2)
    records = records.take(records.label < 6)
    ends = draw_ends(records, WindowSettings(end_after_s=(1.0, 2.2)), "test", per_record=2)
    features, label = statistics(cut(records, ends, WindowSettings())), records.label[ends.row]
    unseen = records.table["seed"].to_numpy()[ends.row] >= 4
    few = TreesSettings(rounds=10)
    trees, again = (fit_trees(features[~unseen], label[~unseen], few, seed=3) for _ in range(2))
    assert (trees.predict(features[unseen]) == label[unseen]).mean() > 0.6
    np.testing.assert_array_equal(trees.decision_function(features), again.decision_function(features))


def test_the_ensemble_says_the_mean_of_both(records: Records, network_run: Run, trees_run: Run, tmp_path: Path) -> None:
    settings = SMALL_RUN.model_copy(update={"model": "ensemble"})
    run = load_run(train_records(records, MADE_OF, tmp_path / "run", settings).path)
    windows = cut(records, draw_ends(records, settings.windows, "test")[:20], settings.windows)
    said, network, trees = (each.predictor(windows) for each in (run, network_run, trees_run))
    np.testing.assert_allclose(said.probabilities, (network.probabilities + trees.probabilities) / 2, atol=1e-6)
    np.testing.assert_array_equal(said.features, network.features)
    np.testing.assert_array_equal(run.reference[0], network_run.reference[0])


@pytest.mark.parametrize("taught", [(0, 3), (0, 2, 5)])
def test_an_intention_that_trees_never_saw_keeps_its_place_among_the_logits(taught: tuple[int, ...]) -> None:
    """An urban network may have no overtakes: the answers are still about six intentions, in their order."""
    records = make_records(4, 2)
    records = records.take(np.isin(records.label, taught))
    ends = draw_ends(records, WindowSettings(), "test")
    windows, label = cut(records, ends, WindowSettings()), records.label[ends.row]
    trees = fit_trees(statistics(windows), label, TreesSettings(rounds=10), seed=3)
    said = TreesPredictor(trees)(windows)
    assert said.logits.shape == (len(label), 6)
    np.testing.assert_array_equal(said.logits.argmax(axis=1), trees.predict(statistics(windows)))
    expected = np.zeros((len(label), 6))
    expected[:, list(taught)] = trees.predict_proba(statistics(windows))
    np.testing.assert_allclose(said.probabilities, expected, atol=1e-9)
