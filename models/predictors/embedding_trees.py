"""Boosted trees on what ASI-BIP makes of a window, beside what the plain trees see.

The network is trained first, and alone; the trees then learn from its features and from the statistics of the same
training windows. The network has seen those windows, so that its features look better there than on others: the trees
may trust them too much. Arrangements of this kind lead on the highD and exiD recordings.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.asi_bip import AsiBipPredictor, AsiBipSettings
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor, WindowShape, Workload
from isac_cosim.models.predictors.trees import (
    TREES_FILE,
    TreesPredictor,
    TreesSettings,
    fit_trees,
    read_trees_beside,
    tree_features,
    tree_logits,
)
from isac_cosim.models.trees.stored_trees import write_trees

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


class EmbeddingTreesPredictor(Predictor):
    """ASI-BIP and trees, each with the settings of its own section; the features are those that the trees see."""

    display_name = "trees on ASI-BIP's embedding"
    summary = "gradient-boosted trees on ASI-BIP's features, the statistics of the window and recent motion"

    def __init__(self, network: AsiBipPredictor, trees: HistGradientBoostingClassifier, tv_rate_hz: float) -> None:
        self.network = network
        self.trees = trees
        self.tv_rate_hz = tv_rate_hz
        self.fit_summary = network.fit_summary

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        network, settings = AsiBipPredictor.fit(task, feedback), task.settings.of(TreesSettings)
        ends, label = task.training_ends(settings.ends_per_record)
        rate_hz = task.shape.tv_rate_hz
        features = np.concatenate([embedded(network, windows, rate_hz) for windows in task.batches(ends)])
        return cls(network, fit_trees(features, label, settings, task.settings.seed), rate_hz)

    def save(self, folder: Path) -> None:
        write_trees(folder / TREES_FILE, self.trees)
        self.network.save(folder)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        network = AsiBipPredictor.load(folder, settings, shape)
        trees = read_trees_beside(folder / TREES_FILE, settings.of(AsiBipSettings).width)
        return cls(network, trees, shape.tv_rate_hz)

    def __call__(self, windows: Windows) -> Outputs:
        features = embedded(self.network, windows, self.tv_rate_hz, self.trees.n_features_in_)
        return Outputs(tree_logits(self.trees, features), features.astype(np.float64))

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        return AsiBipPredictor.cost_s(workload, settings) + TreesPredictor.cost_s(workload, settings)


def embedded(network: AsiBipPredictor, windows: Windows, tv_rate_hz: float, width: int | None = None) -> Float32Array:
    """Return the network's features of windows, then `tree_features`, (n, width).

    width: number of all features that the trees take; by default, that of this version.
    """
    of_network = network(windows).features.astype(np.float32)
    of_window = (
        tree_features(windows, tv_rate_hz)
        if width is None
        else tree_features(windows, tv_rate_hz, width - of_network.shape[1])
    )
    return np.concatenate([of_network, of_window], axis=1)
