"""Gradient-boosted trees: their settings and how they are made, whatever they learn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.settings import Settings
from isac_cosim.models.trees.binning import sorted_once

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


class BoostingSettings(Settings):
    """Settings of scikit-learn's histogram-based trees."""

    rounds: int = Field(200, ge=1, le=100_000, description="boosting rounds")
    learning_rate: float = Field(0.1, gt=0, le=1e3, description="shrinkage of each boosting round")
    leaves: int = Field(15, ge=2, le=1_000_000, description="leaves per tree")
    l2: float = Field(1.0, ge=0, le=1e9, description="L2 regularisation of leaf values")


def boosted_trees(settings: BoostingSettings, seed: int = 0, balanced: bool = False) -> HistGradientBoostingClassifier:
    """Return trees that are still to be fitted. balanced: whether classes are weighted by inverse frequency."""
    from sklearn.ensemble import HistGradientBoostingClassifier  # loaded only here, because it takes long

    return HistGradientBoostingClassifier(
        max_iter=settings.rounds,
        learning_rate=settings.learning_rate,
        max_leaf_nodes=settings.leaves,
        l2_regularization=settings.l2,
        class_weight="balanced" if balanced else None,
        early_stopping=False,
        random_state=seed,
    )


def fitted(
    trees: HistGradientBoostingClassifier, features: Float32Array, label: IntArray, weight: Array | None = None
) -> HistGradientBoostingClassifier:
    """Fit trees to features (n, F) with labels (n,) and weights (n,), all alike without, and return them."""
    with sorted_once():
        return trees.fit(features, label, sample_weight=weight)
