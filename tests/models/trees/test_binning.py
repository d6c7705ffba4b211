"""Bins of weighted features: those of scikit-learn to the last bit, and so are the trees."""

from __future__ import annotations

import numpy as np
import pytest
import sklearn
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sklearn.ensemble._hist_gradient_boosting import binning

from isac_cosim.models.trees.binning import SLOW, sorted_once, thresholds
from isac_cosim.models.trees.boosting import BoostingSettings, boosted_trees, fitted

THEIRS = binning._find_binning_thresholds

pytestmark = pytest.mark.skipif(not sklearn.__version__.startswith(SLOW), reason="this scikit-learn is not slow")


@settings(deadline=None)
@given(st.data(), st.integers(1, 60), st.integers(2, 12))
def test_bins_are_those_of_scikit_learn(data: st.DataObject, count: int, most_bins: int) -> None:
    values = st.one_of(st.sampled_from([-1.0, 0.0, 0.5, 2.0, np.nan]), st.floats(-1e6, 1e6))
    column = data.draw(arrays.arrays(np.float64, count, elements=values))
    weights = st.sampled_from([0.0, 0.25, 1.0, 3.0])
    weight = data.draw(st.one_of(st.none(), arrays.arrays(np.float64, count, elements=weights)))
    if np.isnan(column).all() or (weight is not None and not weight[~np.isnan(column)].any()):
        return
    ours, theirs = thresholds(column, most_bins, weight), THEIRS(column, most_bins, weight)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("decimals", [1, 2, 12])
def test_bins_of_many_values_are_those_of_scikit_learn(decimals: int) -> None:
    rng = np.random.default_rng(decimals)
    for count in (300, 5000):
        column, weight = np.round(rng.normal(size=count), decimals), rng.choice([0.3, 0.7, 1.1, rng.random()], count)
        np.testing.assert_array_equal(thresholds(column, 255, weight), THEIRS(column, 255, weight))


@pytest.mark.parametrize("weighted", [True, False])
def test_trees_are_those_of_scikit_learn(weighted: bool) -> None:
    rng = np.random.default_rng(1)
    features = rng.normal(size=(1500, 5)).astype(np.float32)
    features[rng.random(features.shape) < 0.05] = np.nan
    label = (np.nan_to_num(features[:, 0]) + rng.normal(size=1500) > 0).astype(np.int64)
    weight = rng.uniform(0.5, 2.0, 1500) if weighted else None
    few = BoostingSettings(rounds=10)
    ours = fitted(boosted_trees(few, balanced=True), features, label, weight)
    theirs = boosted_trees(few, balanced=True).fit(features, label, sample_weight=weight)
    np.testing.assert_array_equal(ours.decision_function(features), theirs.decision_function(features))


def test_scikit_learn_is_as_it_was_afterwards() -> None:
    with sorted_once():
        assert binning._find_binning_thresholds is thresholds
    assert binning._find_binning_thresholds is THEIRS
