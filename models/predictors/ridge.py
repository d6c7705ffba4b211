"""The ridge classifier at the end of predictors that are made of very many simple features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray

PENALTIES = np.logspace(-3, 3, 10)
"""Penalties from which leave-one-out validation chooses."""


@dataclass(frozen=True)
class Ridge:
    """A fitted ridge classifier: weight (F, G), offset (G,), and the intentions that it was taught, classes (G,)."""

    weight: Array
    offset: Array
    classes: IntArray

    def decide(self, features: Array | Float32Array) -> Array:
        """Return values (n, G) of features (n, F); fitted to 1 for the true class and to -1 for the others."""
        return np.asarray(features @ self.weight + self.offset)


def fit_ridge(features: Array | Float32Array, label: IntArray) -> Ridge:
    """Fit to features (n, F) with labels (n,), classes weighted by inverse frequency."""
    from sklearn.linear_model import RidgeClassifierCV  # loaded only here, because it takes long

    ridge = RidgeClassifierCV(PENALTIES, class_weight="balanced").fit(features, label)
    weight, offset = np.atleast_2d(ridge.coef_).T, np.atleast_1d(ridge.intercept_)
    if len(ridge.classes_) == 2:
        weight, offset = np.concatenate([-weight, weight], axis=1), np.concatenate([-offset, offset])
    return Ridge(weight, offset, ridge.classes_)
