"""The statistics that the trees see, the trees, and their files."""

import time
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.statistics import MEANS_S, SLOPES_S, STATISTICS, recent_motion, statistics
from isac_cosim.models.data.windows import Records, Windows, WindowSettings, cut, draw_ends
from isac_cosim.models.predictors.trees import (
    N_RECENT,
    N_STATISTICS,
    TreesPredictor,
    TreesSettings,
    fit_trees,
    tree_features,
)
from isac_cosim.models.runs.run import Run
from isac_cosim.models.training.training import train_records
from isac_cosim.models.trees.stored_trees import read_trees, write_trees
from tests.support.made_up import MADE_OF, SMALL_RUN, make_records


def test_statistics_by_hand() -> None:
    rng = np.random.default_rng(0)
    tv, uv = rng.normal(size=(2, 6, 90)).astype(np.float32), rng.normal(size=(2, 6, 30)).astype(np.float32)
    computed = statistics(Windows(tv, uv))
    assert computed.shape == (2, 12 * len(STATISTICS))
    for stream, states in ((0, tv), (1, uv)):
        for component in range(6):
            x = states[1, component].astype(np.float64)
            third = len(x) // 3
            expected = [
                x.mean(), x.std(), x.min(), x.max(), x[0], x[-1], np.polyfit(np.arange(len(x)), x, 1)[0],
                x[:third].mean(), x[third : 2 * third].mean(), x[2 * third :].mean(),
            ]  # fmt: skip
            at = (6 * stream + component) * len(STATISTICS)
            np.testing.assert_allclose(computed[1, at : at + len(STATISTICS)], expected, atol=1e-5)


@pytest.mark.parametrize(("rate_hz", "samples"), [(400.0, 880), (100.0, 220), (10.0, 22), (10.0, 3)])
def test_recent_motion_by_hand(rate_hz: float, samples: int) -> None:
    """At 10 Hz, 0.1 s is one sample; a window of three samples is shorter than 0.4 s, and is taken whole."""
    tv = np.random.default_rng(0).normal(size=(2, 6, samples)).astype(np.float32)
    computed = recent_motion(Windows(tv, tv), rate_hz)
    assert computed.shape == (2, N_RECENT) == (2, 20)
    for place, component in enumerate((2, 3, 4, 5)):
        x = tv[1, component].astype(np.float64)
        counts = [min(round(span_s * rate_hz), samples) for span_s in (*MEANS_S, *SLOPES_S)]
        expected = [x[-count:].mean() for count in counts[:3]]
        expected += [np.polyfit(np.arange(count) / rate_hz, x[-count:], 1)[0] for count in counts[3:]]
        np.testing.assert_allclose(computed[1, 5 * place : 5 * place + 5], expected, rtol=1e-4, atol=1e-5)


def test_recent_motion_of_what_has_just_begun_to_brake() -> None:
    time_s = np.arange(-879, 1) / 400.0
    tv = np.zeros((1, 6, 880), np.float32)
    tv[0, 2] = 30.0 - 4.0 * np.maximum(time_s + 0.2, 0.0)
    slope_over_2, slope_over_4 = recent_motion(Windows(tv, tv), 400.0)[0, [3, 4]]
    assert slope_over_2 == pytest.approx(-4.0, rel=1e-3)
    assert -4.0 < slope_over_4 < -1.0


@pytest.mark.parametrize("width", [120, 140])
def test_trees_of_earlier_versions_load_and_answer(
    records: Records, trees_run: Run, tmp_path: Path, width: int
) -> None:
    """A run whose trees take the 120 statistics answers as those trees do on them."""
    known = records.take(records.label < 6)
    ends = draw_ends(known, SMALL_RUN.windows, "test")
    windows, label = cut(known, ends, SMALL_RUN.windows), known.label[ends.row]
    features = tree_features(windows, known.tv_rate_hz, width)
    assert features.shape[1] == width
    trees = fit_trees(features, label, TreesSettings(rounds=5), seed=1)
    TreesPredictor(trees, known.tv_rate_hz).save(tmp_path)
    loaded = TreesPredictor.load(tmp_path, SMALL_RUN, trees_run.card.shape)
    np.testing.assert_array_equal(loaded(windows).logits.argmax(axis=1), trees.predict(features))
    assert loaded(windows).features.shape == (len(label), width)


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


@pytest.mark.parametrize("taught", [(0, 3), (0, 2, 5)])
def test_an_intention_that_trees_were_not_taught_keeps_its_place_among_the_logits(taught: tuple[int, ...]) -> None:
    """An urban network may have no overtakes: the answers are still about six intentions, in their order."""
    records = make_records(4, 2)
    records = records.take(np.isin(records.label, taught))
    ends = draw_ends(records, WindowSettings(), "test")
    windows, label = cut(records, ends, WindowSettings()), records.label[ends.row]
    trees = fit_trees(statistics(windows), label, TreesSettings(rounds=10), seed=3)
    outputs = TreesPredictor(trees, records.tv_rate_hz)(windows)
    assert outputs.logits.shape == (len(label), 6)
    np.testing.assert_array_equal(outputs.logits.argmax(axis=1), trees.predict(statistics(windows)))
    expected = np.zeros((len(label), 6))
    expected[:, list(taught)] = trees.predict_proba(statistics(windows))
    np.testing.assert_allclose(outputs.probabilities, expected, atol=1e-9)


def test_two_trainings_give_the_same_bytes(records: Records, trees_run: Run, tmp_path: Path) -> None:
    """Neither the time of day nor addresses in memory reach a file."""
    time.sleep(2.1)  # Times in a zip archive have a resolution of two seconds.
    again = train_records(records, MADE_OF, tmp_path / "run", SMALL_RUN.model_copy(update={"model": "trees"}))
    first, second = ({path.name: path.read_bytes() for path in run.path.iterdir()} for run in (trees_run, again))
    assert {"trees.skops", "pre_onset.skops", "reference.npz", "run.json"} <= set(first)
    assert set(first) == set(second)
    assert [name for name, content in first.items() if content != second[name]] == []


def test_what_is_stored_differs_where_the_trees_differ(trees_run: Run, tmp_path: Path) -> None:
    stored = read_trees(trees_run.path / "trees.skops", N_STATISTICS + N_RECENT, KNOWN)
    write_trees(tmp_path / "same.skops", stored)
    assert (tmp_path / "same.skops").read_bytes() == (trees_run.path / "trees.skops").read_bytes()
    stored.learning_rate = 0.2
    write_trees(tmp_path / "other.skops", stored)
    assert (tmp_path / "other.skops").read_bytes() != (trees_run.path / "trees.skops").read_bytes()
    assert read_trees(tmp_path / "other.skops", None, KNOWN).learning_rate == 0.2
