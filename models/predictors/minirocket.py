"""MiniRocket as a floor: random convolutions of both streams, and a ridge classifier on their features.

It needs an optional extra, `pip install '.[minirocket]'` in a checkout, because aeon implements the convolutions. A
trained one is stored as plain arrays. Source: Dempster, Schmidt & Webb 2021.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.arrays import check_array, read_arrays
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows, cut
from isac_cosim.models.networks.network import N_STATES
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor, WindowShape, among_known
from isac_cosim.models.predictors.ridge import Ridge, fit_ridge

ROCKET_FILE = "minirocket.npz"
KERNELS = 84
"""The number of kernels of every MiniRocket."""
PARTS = ("channels_each", "channels", "dilations", "features_each", "biases")
"""What a fitted transform consists of, in aeon's order: number of channels of every kernel with every dilation, which
channels these are, dilations, features of every dilation, and the bias of every feature.
"""


class MinirocketSettings(Settings):
    """Size of the transform, and what it is trained on."""

    features: int = Field(
        10_000,
        ge=2 * KERNELS,
        le=1_000_000,
        description="approximate number of features per window, half of them of each stream",
    )
    ends_per_record: int = Field(1, ge=1, le=10_000, description="training windows per record")


class MinirocketPredictor(Predictor):
    """A trained MiniRocket. Its features are its logits, because those of its transform are too many to keep."""

    display_name = "MiniRocket"
    summary = "random convolutions of both streams and a ridge classifier (optional extra)"
    settings_class: ClassVar[type[Settings] | None] = MinirocketSettings
    optional_packages: ClassVar[Mapping[str, str]] = {"aeon": "pip install '.[minirocket]' in a checkout"}

    def __init__(self, rocket: Rocket) -> None:
        self.rocket = rocket

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        settings = task.settings.of(MinirocketSettings)
        ends, label = task.training_ends(settings.ends_per_record)
        windows = cut(task.training, ends, task.settings.windows)
        return cls(fit_rocket(windows, label, settings, task.settings.seed))

    def save(self, folder: Path) -> None:
        replace_file(folder / ROCKET_FILE, lambda path: write_rocket(self.rocket, path))

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        return cls(read_rocket(folder / ROCKET_FILE, (shape.tv_length, shape.uv_length)))

    def __call__(self, windows: Windows) -> Outputs:
        logits = among_known(self.rocket.decide(windows), self.rocket.ridge.classes)
        return Outputs(logits, logits)


@dataclass(frozen=True)
class Rocket:
    """A trained MiniRocket.

    rockets: aeon's transforms of the TV's and of the UV's stream. mean, sd: (2, 6), of the components of the streams,
    which are standardised by them. centre, scale: (F,), the same of the features.
    """

    rockets: tuple[Any, Any]
    mean: Array
    sd: Array
    centre: Array
    scale: Array
    ridge: Ridge

    def decide(self, windows: Windows) -> Array:
        """Return the values of the ridge, (n, G)."""
        features = transformed(self.rockets, standardised(windows, self.mean, self.sd))
        return self.ridge.decide((features - self.centre) / self.scale)


def fit_rocket(windows: Windows, label: IntArray, settings: MinirocketSettings, seed: int) -> Rocket:
    """Fit to windows with labels (n,), classes weighted by inverse frequency."""
    transform_class = rocket_class()
    mean, sd = stream_scale(windows)
    scaled = standardised(windows, mean, sd)
    count = settings.features // 2
    rockets = tuple(transform_class(n_kernels=count, random_state=seed % 2**31).fit(x) for x in scaled)
    features = transformed(rockets, scaled)
    centre, scale = features.mean(axis=0, dtype=np.float64), features.std(axis=0, dtype=np.float64) + 1e-6
    ridge = fit_ridge((features - centre) / scale, label)
    return Rocket((rockets[0], rockets[1]), mean, sd, centre, scale, ridge)


def stream_scale(windows: Windows) -> tuple[Array, Array]:
    """Return means and standard deviations of the components of both streams, (2, 6) each."""
    streams = (windows.tv, windows.uv)
    mean = np.stack([x.mean(axis=(0, 2), dtype=np.float64) for x in streams])
    sd = np.stack([x.std(axis=(0, 2), dtype=np.float64) + 1e-6 for x in streams])
    return mean, sd


def standardised(windows: Windows, mean: Array, sd: Array) -> tuple[Float32Array, Float32Array]:
    """Return both streams standardised by means and standard deviations of their components, (2, 6)."""
    tv, uv = (
        ((x - m[:, None]) / s[:, None]).astype(np.float32)
        for x, m, s in zip((windows.tv, windows.uv), mean, sd, strict=True)
    )
    return tv, uv


def transformed(rockets: tuple[Any, ...], streams: tuple[Float32Array, Float32Array]) -> Float32Array:
    """Return features (n, F) of standardised streams (n, 6, T) and (n, 6, U)."""
    return np.concatenate([rocket.transform(x) for rocket, x in zip(rockets, streams, strict=True)], axis=1)


def write_rocket(rocket: Rocket, path: Path) -> None:
    """Write a trained MiniRocket as plain arrays."""
    arrays = {name: getattr(rocket, name) for name in ("mean", "sd", "centre", "scale")} | vars(rocket.ridge)
    for k, transform in enumerate(rocket.rockets):
        arrays |= {f"{name}_{k}": part for name, part in zip(PARTS, transform.parameters, strict=True)}
    np.savez_compressed(path, **arrays)


def read_rocket(path: Path, lengths: tuple[int, int]) -> Rocket:
    """Read what `write_rocket` wrote.

    lengths: samples per window of the TV's and of the UV's stream.
    Raises ValueError or LookupError if the file holds anything else.
    """
    transform_class = rocket_class()
    arrays = read_arrays(path)
    check_scale(arrays)
    rockets = []
    for k, length in enumerate(lengths):
        parts = tuple(arrays.pop(f"{name}_{k}") for name in PARTS)
        check(parts, length)
        # aeon has no other way to make a fitted transform: fit to any varying input, then replace the parameters.
        rocket = transform_class(n_kernels=KERNELS).fit(np.tile(np.arange(length, dtype=np.float32), (2, N_STATES, 1)))
        rocket.parameters = parts
        rockets.append(rocket)
    width = sum(len(rocket.parameters[-1]) for rocket in rockets)
    ridge = read_ridge(arrays, width)
    for name in ("centre", "scale"):
        check_array(arrays, name, "f", (width,))
    if (arrays["scale"] <= 0).any():
        raise ValueError("scale: is not positive")
    return Rocket((rockets[0], rockets[1]), **arrays, ridge=ridge)


def check_scale(arrays: dict[str, npt.NDArray[Any]]) -> None:
    """Raise ValueError unless the arrays of a file hold the scale of both streams."""
    for name in ("mean", "sd"):
        check_array(arrays, name, "f", (2, N_STATES))
    if (arrays["sd"] <= 0).any():
        raise ValueError("sd: is not positive")


def read_ridge(arrays: dict[str, npt.NDArray[Any]], width: int) -> Ridge:
    """Take a classifier of `width` features out of the arrays of a file. Raises ValueError if it is none."""
    classes = check_array(arrays, "classes", "iu", (None,))
    if len(classes) < 2 or (np.diff(classes.astype(np.int64)) <= 0).any() or not set(classes.tolist()) <= set(KNOWN):
        raise ValueError(f"classes: are {classes.tolist()}, not some of {[int(known) for known in KNOWN]} in order")
    check_array(arrays, "weight", "f", (width, len(classes)))
    check_array(arrays, "offset", "f", (len(classes),))
    if not arrays["weight"].any():
        raise ValueError("weight: is zero throughout")
    return Ridge(*(arrays.pop(part.name) for part in fields(Ridge)))


def check(parts: tuple[npt.NDArray[Any], ...], length: int) -> None:
    """Raise ValueError unless a transform with these PARTS stays inside its arrays; aeon's compiled loops do not check.

    length: samples per window.
    """
    channels_each, channels, dilations, features, biases = parts
    sound = (
        all(part.ndim == 1 for part in parts)
        and all(part.dtype == np.int32 for part in (channels_each, channels, dilations))
        and np.issubdtype(features.dtype, np.integer)
        and biases.dtype == np.float32
        and len(channels_each) == KERNELS * len(dilations)
        and len(features) == len(dilations) > 0
        and min(channels_each.min(), dilations.min(), features.min()) > 0
        and len(channels) == channels_each.sum()
        and 0 <= channels.min() <= channels.max() < N_STATES
        and len(biases) == KERNELS * features.sum()
        and 8 * dilations.max() < length
    )
    if not sound:
        raise ValueError("not the parameters of a Rocket transform")


def rocket_class() -> Any:
    """Return aeon's transform."""
    return importlib.import_module("aeon.transformations.collection.convolution_based").MiniRocket
