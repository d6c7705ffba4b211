"""Boosted trees on what ASI-BIP makes of a window, beside the statistics that the plain trees see.

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
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.statistics import N_STATISTICS, statistics
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.asi_bip import AsiBipPredictor, AsiBipSettings
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor, WindowShape, Workload
from isac_cosim.models.predictors.trees import TREES_FILE, TreesPredictor, TreesSettings, fit_trees, tree_logits
from isac_cosim.models.trees.stored_trees import read_trees, write_trees

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


class EmbeddingTreesPredictor(Predictor):
    """ASI-BIP and trees, each with the settings of its own section; the features are those that the trees see."""

    display_name = "trees on ASI-BIP's embedding"
    summary = "gradient-boosted trees on ASI-BIP's features and the statistics of the window"

    def __init__(self, network: AsiBipPredictor, trees: HistGradientBoostingClassifier) -> None:
        self.network = network
        self.trees = trees
        self.fit_summary = network.fit_summary

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        network, settings = AsiBipPredictor.fit(task, feedback), task.settings.of(TreesSettings)
        ends, label = task.training_ends(settings.ends_per_record)
        features = np.concatenate([embedded(network, windows) for windows in task.batches(ends)])
        return cls(network, fit_trees(features, label, settings, task.settings.seed))

    def save(self, folder: Path) -> None:
        write_trees(folder / TREES_FILE, self.trees)
        self.network.save(folder)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        network = AsiBipPredictor.load(folder, settings, shape)
        width = settings.of(AsiBipSettings).width + N_STATISTICS
        return cls(network, read_trees(folder / TREES_FILE, width, KNOWN))

    def __call__(self, windows: Windows) -> Outputs:
        features = embedded(self.network, windows)
        return Outputs(tree_logits(self.trees, features), features.astype(np.float64))

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        return AsiBipPredictor.cost_s(workload, settings) + TreesPredictor.cost_s(workload, settings)


def embedded(network: AsiBipPredictor, windows: Windows) -> Float32Array:
    """Return the network's features of windows, then their statistics, (n, width + 120)."""
    return np.concatenate([network(windows).features.astype(np.float32), statistics(windows)], axis=1)
