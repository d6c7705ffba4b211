"""Floors: plain predictors on the same windows, that a network has to beat.

`trees` are gradient-boosted trees on one-line statistics of both streams; `aligned` is what ASI-BIP claims to
beat: both streams at one rate in one LSTM. ASI-BIP with one branch (`tv-alone`, `uv-alone`) is in
`models.predictors.asi_bip`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from sklearn.ensemble import HistGradientBoostingClassifier
from torch import Tensor, nn

from isacsim.arrays import Array, Float32Array
from isacsim.settings import Settings
from models.data.windows import Windows
from models.predictors.network import N_STATES, WindowNetwork, linear_head

STATISTICS = (
    "mean",
    "sd",
    "min",
    "max",
    "first",
    "last",
    "slope",
    "mean_first_third",
    "mean_middle_third",
    "mean_last_third",
)
"""What is taken of each of the twelve state components of a window; the slope is the least-squares one, per sample."""


class TreesSettings(Settings):
    """Gradient-boosted trees (scikit-learn's histogram kind)."""

    rounds: int = Field(200, ge=1, description="boosting rounds")
    learning_rate: float = Field(0.1, gt=0, description="shrinkage of a round")
    leaves: int = Field(15, ge=2, description="leaves of a tree")
    l2: float = Field(1.0, ge=0, description="L2 regularisation of leaf values")
    ends_per_record: int = Field(4, ge=1, description="training windows drawn of each record")


class AlignedSettings(Settings):
    """One bidirectional LSTM over both streams, interpolated to one rate."""

    length: int = Field(220, ge=2, description="samples of a window after interpolation; 220 of 2.2 s are 100 Hz")
    hidden: int = Field(64, ge=1, description="units of one LSTM direction")
    layers: int = Field(1, ge=1, description="LSTM layers")
    dropout: float = Field(0.1, ge=0, lt=1, description="before the head")


class Aligned(WindowNetwork):
    """Aligned fusion: streams interpolated to `length` samples, one Bi-LSTM, mean over time, linear head.

    The streams' last samples coincide; their first ones lie less than one sample apart.
    """

    def __init__(self, settings: AlignedSettings, n_classes: int) -> None:
        super().__init__(n_classes)
        self.head = linear_head(2 * settings.hidden, n_classes, settings.dropout)
        self.settings = settings
        self.lstm = nn.LSTM(2 * N_STATES, settings.hidden, settings.layers, bidirectional=True)

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Mean LSTM output, (B, 2 hidden), of standardised streams (B, 6, T) and (B, 6, U)."""
        size = self.settings.length
        both = [nn.functional.interpolate(x, size, mode="linear", align_corners=True) for x in (tv, uv)]
        return torch.as_tensor(self.lstm(torch.cat(both, dim=1).permute(2, 0, 1))[0].mean(dim=0))


def statistics(windows: Windows) -> Float32Array:
    """STATISTICS of every component of the TV's, then of the UV's stream, (n, 120)."""
    return np.concatenate([_of_stream(windows.tv), _of_stream(windows.uv)], axis=1).astype(np.float32)


def _of_stream(states: Float32Array) -> Array:
    """(n, 60) of (n, 6, T), component by component."""
    x = states.astype(np.float64)
    t = np.arange(x.shape[2]) - (x.shape[2] - 1) / 2
    thirds = [part.mean(axis=2) for part in np.array_split(x, 3, axis=2)]
    slope = x @ t / (t @ t)
    parts = [x.mean(axis=2), x.std(axis=2), x.min(axis=2), x.max(axis=2), x[..., 0], x[..., -1], slope, *thirds]
    return np.stack(parts, axis=2).reshape(len(x), -1)


def fit_trees(
    features: Float32Array, label: npt.NDArray[np.int64], settings: TreesSettings, seed: int
) -> HistGradientBoostingClassifier:
    """Trees on statistics (n, 120), classes weighted by inverse frequency."""
    trees = HistGradientBoostingClassifier(
        max_iter=settings.rounds, learning_rate=settings.learning_rate, max_leaf_nodes=settings.leaves,
        l2_regularization=settings.l2, class_weight="balanced", early_stopping=False, random_state=seed,
    )  # fmt: skip
    return trees.fit(features, label)
