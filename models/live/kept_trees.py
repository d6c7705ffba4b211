"""Boosted trees that are kept under the digest of what they were trained on, so that none are trained twice."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import sklearn
from sklearn.ensemble import HistGradientBoostingClassifier

from isacsim.arrays import Array, Float32Array, IntArray
from isacsim.errors import InputError
from isacsim.files import remove_partial
from models.live.settings import BackgroundSettings
from models.networks.checkpoints import READ_ERRORS, reason_of
from models.predictors.stored_trees import read_trees, write_trees

TREES_FOLDER = "trees"
"""In the folder of an evaluation."""
SUFFIX = ".skops"


@dataclass
class KeptTrees:
    """Trains trees, or reads them from a folder where the same ones have been trained before.

    folder: where they are kept; None keeps none.
    """

    folder: Path | None = None
    _wanted: set[str] = field(default_factory=set, init=False)

    def trained(
        self, features: Float32Array, label: IntArray, weight: Array, settings: BackgroundSettings
    ) -> HistGradientBoostingClassifier:
        """Return trees trained on windows. features: (n, F). label, weight: (n,).

        Raises OutputError where they cannot be written, InputError where a file of trees is damaged.
        """
        trees = HistGradientBoostingClassifier(
            max_iter=settings.rounds, learning_rate=settings.learning_rate, max_leaf_nodes=settings.leaves,
            l2_regularization=settings.l2, early_stopping=False, random_state=0,
        )  # fmt: skip
        if self.folder is None:
            return trees.fit(features, label, sample_weight=weight)
        path = self.folder / (_digest(trees, features, label, weight) + SUFFIX)
        self._wanted.add(path.name)
        if path.is_file():
            return _read(path, features.shape[1], np.unique(label).tolist())
        trees.fit(features, label, sample_weight=weight)
        self.folder.mkdir(exist_ok=True)
        write_trees(path, trees)
        return trees

    def remove_others(self) -> None:
        """Delete from the folder what nobody has asked for, such as trees of other development seeds."""
        if self.folder is None or not self.folder.is_dir():
            return
        remove_partial(self.folder, f"*{SUFFIX}")
        for path in self.folder.glob(f"*{SUFFIX}"):
            if path.name not in self._wanted:
                path.unlink()


NOT_KEPT = KeptTrees()
"""Trains trees every time."""


def _read(path: Path, n_features: int, classes: Sequence[int]) -> HistGradientBoostingClassifier:
    try:
        trees = read_trees(path, n_features, classes)
        if trees.classes_.tolist() != classes:
            raise ValueError(f"classes_: are not {classes}")
        return trees
    except READ_ERRORS as error:
        raise InputError(
            f"{path}: is damaged ({reason_of(error)}); delete it, and the trees are trained again"
        ) from None


def _digest(trees: HistGradientBoostingClassifier, features: Float32Array, label: IntArray, weight: Array) -> str:
    digest = hashlib.sha256(repr((sklearn.__version__, features.shape, sorted(trees.get_params().items()))).encode())
    for values in (features, label, weight):
        digest.update(np.ascontiguousarray(values).data)
    return digest.hexdigest()
