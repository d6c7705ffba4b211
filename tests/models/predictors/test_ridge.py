"""The ridge classifier, and the scale of the streams before it: against scikit-learn and against their definition."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.linear_model import RidgeClassifierCV

from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.minirocket import standardised, stream_scale
from isac_cosim.models.predictors.ridge import PENALTIES, fit_ridge


@pytest.mark.parametrize("classes", [(1, 4), (0, 2, 5)])
def test_its_values_are_those_of_scikit_learn(classes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(len(classes))
    label = rng.choice(classes, 90)
    features = rng.normal(size=(90, 12)) + label[:, None] * rng.normal(size=12)
    ridge = fit_ridge(features, label)
    assert ridge.classes.tolist() == list(classes)
    values = ridge.decide(features)
    expected = RidgeClassifierCV(PENALTIES, class_weight="balanced").fit(features, label)
    decision = expected.decision_function(features)
    # With two classes, scikit-learn has one value, that of the second.
    np.testing.assert_allclose(values, decision if decision.ndim == 2 else np.stack([-decision, decision], axis=1))
    np.testing.assert_array_equal(ridge.classes[values.argmax(axis=1)], expected.predict(features))


def test_streams_are_standardised_by_component() -> None:
    rng = np.random.default_rng(7)
    scale = np.array([1.0, 2.0, 5.0, 0.1, 3.0, 0.5])[:, None]
    windows = Windows(
        (rng.normal(size=(40, 6, 88)) * scale + 9.0).astype(np.float32),
        (rng.normal(size=(40, 6, 22)) * scale - 4.0).astype(np.float32),
    )
    mean, sd = stream_scale(windows)
    for stream in standardised(windows, mean, sd):
        np.testing.assert_allclose(stream.mean(axis=(0, 2)), 0.0, atol=1e-4)
        np.testing.assert_allclose(stream.std(axis=(0, 2)), 1.0, atol=1e-3)
