"""The ensemble: the mean of the probabilities of ASI-BIP and of boosted trees."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import numpy as np

from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.predictors.asi_bip import AsiBipPredictor
from isac_cosim.models.predictors.protocol import LEAST_PROBABILITY, FitTask, Outputs, Predictor, WindowShape, Workload
from isac_cosim.models.predictors.trees import TreesPredictor


class EnsemblePredictor(Predictor):
    """ASI-BIP and trees, each with the settings of its own section; the features are those of the network."""

    display_name = "ASI-BIP with trees"
    summary = "mean of the probabilities of ASI-BIP and boosted trees"

    def __init__(self, network: AsiBipPredictor, trees: TreesPredictor) -> None:
        self.network = network
        self.trees = trees
        self.fit_summary = network.fit_summary

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        trees = TreesPredictor.fit(task, feedback)
        return cls(AsiBipPredictor.fit(task, feedback), trees)

    def save(self, folder: Path) -> None:
        self.trees.save(folder)
        self.network.save(folder)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        return cls(AsiBipPredictor.load(folder, settings, shape), TreesPredictor.load(folder, settings, shape))

    def __call__(self, windows: Windows) -> Outputs:
        by_network, by_trees = self.network(windows), self.trees(windows)
        mean = (by_network.probabilities + by_trees.probabilities) / 2
        return Outputs(np.log(np.maximum(mean, LEAST_PROBABILITY)), by_network.features)

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        return AsiBipPredictor.cost_s(workload, settings) + TreesPredictor.cost_s(workload, settings)
