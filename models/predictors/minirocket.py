"""MiniRocket as a floor: random convolutions of both streams, read by a ridge classifier.

An optional extra, `pip install 'isac-cosim[minirocket]'`: aeon has the convolutions. A trained one is stored as plain
arrays. Source: Dempster, Schmidt & Webb 2021.
"""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field
from sklearn.linear_model import RidgeClassifierCV

from isacsim.arrays import Array, Float32Array, IntArray
from isacsim.errors import InputError
from isacsim.settings import Settings
from models.data.windows import Windows
from models.predictors.network import N_STATES

KERNELS = 84
"""Every set of MiniRocket's kernels has so many."""
PARTS = ("channels_each", "channels", "dilations", "features_each", "biases")
"""What a fitted transform consists of, in aeon's order: number of channels of every kernel with every dilation, which
ones these are, dilations, features of every dilation, and the bias of every feature.
"""
PENALTIES = np.logspace(-3, 3, 10)
"""Of the ridge, of which leave-one-out validation chooses."""


class MinirocketSettings(Settings):
    """Size of the transform, and what it is trained on."""

    features: int = Field(10_000, ge=2 * KERNELS, description="features of a window, half of each stream, about")
    ends_per_record: int = Field(1, ge=1, description="training windows drawn of each record")


@dataclass(frozen=True)
class Rocket:
    """A trained MiniRocket.

    rockets: aeon's transforms of the TV's and of the UV's stream. mean, sd: (2, 6), what their channels are
    standardised by; centre, scale: (F,), what the features are. weight: (F, G) and offset: (G,) of the ridge.
    classes: (G,), the intentions it was taught.
    """

    rockets: tuple[Any, Any]
    mean: Array
    sd: Array
    centre: Array
    scale: Array
    weight: Array
    offset: Array
    classes: IntArray

    def decide(self, windows: Windows) -> Array:
        """The ridge's values, (n, G): 1 is what it was taught for a class, -1 for the others."""
        features = transformed(self.rockets, standardised(windows, self.mean, self.sd))
        return ((features - self.centre) / self.scale) @ self.weight + self.offset


def fit_rocket(windows: Windows, label: IntArray, settings: MinirocketSettings, seed: int) -> Rocket:
    """Train on windows with labels (n,), classes weighted by inverse frequency. InputError where aeon is missing."""
    kind = rocket_kind()
    streams = (windows.tv, windows.uv)
    mean = np.stack([x.mean(axis=(0, 2), dtype=np.float64) for x in streams])
    sd = np.stack([x.std(axis=(0, 2), dtype=np.float64) + 1e-6 for x in streams])
    seen = standardised(windows, mean, sd)
    each = settings.features // 2
    rockets = tuple(kind(n_kernels=each, random_state=seed % 2**31).fit(x) for x in seen)
    features = transformed(rockets, seen)
    centre, scale = features.mean(axis=0, dtype=np.float64), features.std(axis=0, dtype=np.float64) + 1e-6
    ridge = RidgeClassifierCV(PENALTIES, class_weight="balanced").fit((features - centre) / scale, label)
    weight, offset = np.atleast_2d(ridge.coef_).T, np.atleast_1d(ridge.intercept_)
    if len(ridge.classes_) == 2:
        weight, offset = np.concatenate([-weight, weight], axis=1), np.concatenate([-offset, offset])
    return Rocket((rockets[0], rockets[1]), mean, sd, centre, scale, weight, offset, ridge.classes_)


def standardised(windows: Windows, mean: Array, sd: Array) -> tuple[Float32Array, Float32Array]:
    """Both streams by the channels' means and standard deviations, (2, 6)."""
    tv, uv = (
        ((x - m[:, None]) / s[:, None]).astype(np.float32)
        for x, m, s in zip((windows.tv, windows.uv), mean, sd, strict=True)
    )
    return tv, uv


def transformed(rockets: tuple[Any, ...], streams: tuple[Float32Array, Float32Array]) -> Float32Array:
    """Features (n, F) of standardised streams (n, 6, T) and (n, 6, U)."""
    return np.concatenate([each.transform(x) for each, x in zip(rockets, streams, strict=True)], axis=1)


def write_rocket(rocket: Rocket, path: Path) -> None:
    """Write it as arrays."""
    arrays = {name: getattr(rocket, name) for name in ("mean", "sd", "centre", "scale", "weight", "offset", "classes")}
    for k, each in enumerate(rocket.rockets):
        arrays |= {f"{name}_{k}": part for name, part in zip(PARTS, each.parameters, strict=True)}
    np.savez_compressed(path, **arrays)


def read_rocket(path: Path, lengths: tuple[int, int]) -> Rocket:
    """What `write_rocket` wrote, for windows of those samples in both streams.

    ValueError or LookupError where it holds anything else; InputError where aeon is missing.
    """
    kind = rocket_kind()
    with np.load(path, allow_pickle=False) as stored:
        arrays = dict(stored)
    rockets = []
    for k, length in enumerate(lengths):
        parts = tuple(arrays.pop(f"{name}_{k}") for name in PARTS)
        check(parts, length)
        # Fitted on anything that varies, lest it warn: what it learns is put aside for what was read.
        rocket = kind(n_kernels=KERNELS).fit(np.tile(np.arange(length, dtype=np.float32), (2, N_STATES, 1)))
        rocket.parameters = parts
        rockets.append(rocket)
    return Rocket((rockets[0], rockets[1]), **arrays)


def check(parts: tuple[npt.NDArray[Any], ...], length: int) -> None:
    """ValueError unless a transform of such parts stays inside its arrays: compiled loops do not look."""
    each, channels, dilations, features, biases = parts
    sound = (
        all(part.ndim == 1 for part in parts)
        and all(part.dtype == np.int32 for part in (each, channels, dilations))
        and np.issubdtype(features.dtype, np.integer)
        and biases.dtype == np.float32
        and len(each) == KERNELS * len(dilations)
        and len(features) == len(dilations) > 0
        and min(each.min(), dilations.min(), features.min()) > 0
        and len(channels) == each.sum()
        and 0 <= channels.min() <= channels.max() < N_STATES
        and len(biases) == KERNELS * features.sum()
        and 8 * dilations.max() < length
    )
    if not sound:
        raise ValueError("not the parameters of a MiniRocket transform")


def rocket_kind() -> Any:
    """aeon's transform. InputError where it is not installed."""
    if importlib.util.find_spec("aeon") is None:
        raise InputError("model minirocket needs aeon, an optional extra: pip install 'isac-cosim[minirocket]'")
    return importlib.import_module("aeon.transformations.collection.convolution_based").MiniRocket
