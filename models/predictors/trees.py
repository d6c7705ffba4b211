"""Boosted trees: gradient-boosted trees on simple statistics of both streams, the floor that a network has to beat."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.statistics import N_RECENT, N_STATISTICS, recent_motion, statistics
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.protocol import (
    STATISTICS_S,
    FitTask,
    Outputs,
    Predictor,
    WindowShape,
    Workload,
    among_known,
)
from isac_cosim.models.trees.boosting import BoostingSettings, boosted_trees, fitted
from isac_cosim.models.trees.stored_trees import read_trees, write_trees

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

TREES_FILE = "trees.skops"
BINNED_S, BINNED_WINDOW_S = 5.0, 1e-3
"""Processor time of sorting features into bins before the trees grow, and what each window adds to it, s."""
ROUND_S = 0.025
"""Processor time of a boosting round, s."""


class TreesSettings(BoostingSettings):
    """Settings of the trees."""

    ends_per_record: int = Field(9, ge=1, le=10_000, description="training windows per record")


class TreesPredictor(Predictor):
    """Boosted trees, whose features are the statistics of the window and the TV's recent motion.

    Trees of earlier versions take the statistics alone.
    """

    display_name = "boosted trees"
    summary = "gradient-boosted trees on simple statistics of the window and recent motion"
    settings_class: ClassVar[type[Settings] | None] = TreesSettings

    def __init__(self, trees: HistGradientBoostingClassifier, tv_rate_hz: float) -> None:
        self.trees = trees
        self.tv_rate_hz = tv_rate_hz

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        settings = task.settings.of(TreesSettings)
        ends, label = task.training_ends(settings.ends_per_record)
        rate_hz = task.shape.tv_rate_hz
        features = np.concatenate([tree_features(windows, rate_hz) for windows in task.batches(ends)])
        return cls(fit_trees(features, label, settings, task.settings.seed), rate_hz)

    def save(self, folder: Path) -> None:
        write_trees(folder / TREES_FILE, self.trees)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        return cls(read_trees_beside(folder / TREES_FILE, 0), shape.tv_rate_hz)

    def __call__(self, windows: Windows) -> Outputs:
        features = tree_features(windows, self.tv_rate_hz, self.trees.n_features_in_)
        return Outputs(tree_logits(self.trees, features), features.astype(np.float64))

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        trees = settings.of(TreesSettings)
        windows = workload.training * trees.ends_per_record
        statistics_s = STATISTICS_S * workload.scale * (windows + workload.tested)
        return statistics_s + windows * BINNED_WINDOW_S + BINNED_S + trees.rounds * ROUND_S


def tree_features(windows: Windows, tv_rate_hz: float, width: int = N_STATISTICS + N_RECENT) -> Float32Array:
    """Return what trees take of windows, (n, width): the statistics, and if they take more, the recent motion."""
    features = statistics(windows)
    return features if width == N_STATISTICS else np.concatenate([features, recent_motion(windows, tv_rate_hz)], axis=1)


def read_trees_beside(path: Path, others: int) -> HistGradientBoostingClassifier:
    """Read trees that take `others` features and then those of `tree_features`, of this version or an earlier one.

    Raises one of READ_ERRORS if the file is damaged, or its trees take another number of features.
    """
    return read_trees(path, [others + N_STATISTICS + more for more in (N_RECENT, 0)], KNOWN)


def tree_logits(trees: HistGradientBoostingClassifier, features: Float32Array) -> Array:
    """Return the logits of all known intentions, (n, G), for features (n, F)."""
    logits = np.asarray(trees.decision_function(features))
    if logits.ndim == 1:  # Of two classes, scikit-learn gives the log-odds of the second.
        logits = np.stack([np.zeros_like(logits), logits], axis=1)
    return among_known(logits, trees.classes_)


def fit_trees(
    features: Float32Array, label: IntArray, settings: TreesSettings, seed: int
) -> HistGradientBoostingClassifier:
    """Fit trees to features (n, F) with labels (n,), classes weighted by inverse frequency."""
    return fitted(boosted_trees(settings, seed, balanced=True), features, label)
