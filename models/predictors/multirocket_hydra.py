"""MultiRocket with Hydra as a floor: the strongest of the fast classifiers of series of any kind.

Random convolutions of each stream and of its differences, pooled in four ways (MultiRocket), and counts of which kernel
of a group fits best at each time (Hydra); a ridge classifier on all of it. It needs an optional extra, `pip install
'.[minirocket]'` in a checkout, because aeon implements both transforms. A trained one is stored as plain arrays.
Sources: Tan et al. 2022, "MultiRocket"; Dempster, Schmidt & Webb 2023, "Hydra: competing convolutional kernels".
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.base.stored.arrays import check_array, read_arrays
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows, cut
from isac_cosim.models.networks.network import N_STATES
from isac_cosim.models.predictors.minirocket import (
    KERNELS,
    PARTS,
    check,
    check_scale,
    read_ridge,
    standardised,
    stream_scale,
)
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor, WindowShape, Workload, among_known
from isac_cosim.models.predictors.ridge import Ridge, fit_ridge

FILE = "multirocket_hydra.npz"
POOLINGS = 4
"""Features that MultiRocket makes of each kernel: in two representations, the stream and its differences, each."""
GROUP_KERNELS = 8
"""Kernels that compete in each of Hydra's groups."""
HALVES = 2
"""Half of Hydra's groups see the stream, half its differences."""
BATCH = 64
"""Windows that Hydra transforms at once; it keeps every convolution of them in memory."""
WINDOW_S = 0.02
"""Processor time of both transforms of a default window, s."""


class MultirocketHydraSettings(Settings):
    """Sizes of the transforms, and what they are trained on."""

    features: int = Field(
        50_000,
        ge=2 * 2 * POOLINGS * KERNELS,
        le=1_000_000,
        description="approximate number of MultiRocket's features per window, half of them of each stream",
    )
    groups: int = Field(
        64, ge=2, le=65_536, multiple_of=2, description="Hydra's groups of eight kernels at each dilation"
    )
    ends_per_record: int = Field(1, ge=1, le=10_000, description="training windows per record")
    step_s: float = Field(
        0.02, ge=0.0, le=1e3, description="samples of a stream are averaged over this time, s; 0 takes every sample"
    )


class MultirocketHydraPredictor(Predictor):
    """A trained MultiRocket with Hydra. Its features are its logits, because those of its transforms are too many."""

    display_name = "MultiRocket-Hydra"
    summary = "many random convolutions of both streams and a ridge classifier (optional extra)"
    settings_class: ClassVar[type[Settings] | None] = MultirocketHydraSettings
    optional_packages: ClassVar[Mapping[str, str]] = {"aeon": "pip install '.[minirocket]' in a checkout"}

    def __init__(self, rocket: RocketWithHydra, averaging: Averaging) -> None:
        self.rocket = rocket
        self.averaging = averaging

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        settings = task.settings.of(MultirocketHydraSettings)
        ends, label = task.training_ends(settings.ends_per_record)
        averaging = Averaging.of(settings, task.shape)
        windows = averaging(cut(task.training, ends, task.settings.windows))
        return cls(fit_rocket(windows, label, settings, task.settings.seed), averaging)

    def save(self, folder: Path) -> None:
        replace_file(folder / FILE, lambda path: write_rocket(self.rocket, path))

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        averaging = Averaging.of(settings.of(MultirocketHydraSettings), shape)
        return cls(read_rocket(folder / FILE, averaging.lengths(shape)), averaging)

    def __call__(self, windows: Windows) -> Outputs:
        logits = among_known(self.rocket.decide(self.averaging(windows)), self.rocket.ridge.classes)
        return Outputs(logits, logits)

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        ends = settings.of(MultirocketHydraSettings).ends_per_record
        return WINDOW_S * workload.scale * (workload.training * ends + workload.tested)


@dataclass(frozen=True)
class Averaging:
    """Means of consecutive samples. tv, uv: samples in a mean, of each stream."""

    tv: int
    uv: int

    @classmethod
    def of(cls, settings: MultirocketHydraSettings, shape: WindowShape) -> Self:
        """Return the averaging of windows of some shape."""
        return cls(*(max(1, round(settings.step_s * rate)) for rate in (shape.tv_rate_hz, shape.uv_rate_hz)))

    def lengths(self, shape: WindowShape) -> tuple[int, int]:
        """Return how many means a window has of the TV's and of the UV's stream."""
        return shape.tv_length // self.tv, shape.uv_length // self.uv

    def __call__(self, windows: Windows) -> Windows:
        """Return windows of means; the oldest samples that do not fill a mean are left out."""
        return Windows(_means(windows.tv, self.tv), _means(windows.uv, self.uv))


def _means(x: Float32Array, count: int) -> Float32Array:
    """Return the means of so many consecutive samples of streams (n, 6, T), as (n, 6, T // count)."""
    length = x.shape[2] // count
    return np.asarray(x[:, :, x.shape[2] - length * count :].reshape(*x.shape[:2], length, count).mean(axis=3))


@dataclass(frozen=True)
class Transforms:
    """aeon's fitted transforms of one stream."""

    rocket: Any
    hydra: Any

    def __call__(self, x: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return MultiRocket's and Hydra's features, each (n, F), of standardised streams (n, 6, T)."""
        counts = [self.hydra.transform(x[start : start + BATCH]) for start in range(0, len(x), BATCH)]
        # The square root of the counts, as in Hydra's own classifier.
        return self.rocket.transform(x), np.sqrt(np.concatenate(counts).clip(0.0))


@dataclass(frozen=True)
class Scaling:
    """The scale of features: MultiRocket's are standardised; of Hydra's, those that are not zero (its `SparseScaler`).

    Each has a centre and a scale, (F,).
    """

    rocket_centre: Float32Array
    rocket_scale: Float32Array
    hydra_centre: Float32Array
    hydra_scale: Float32Array

    @classmethod
    def of(cls, rocket: Float32Array, hydra: Float32Array) -> Scaling:
        """Return the scaling that features (n, F) of training windows give."""
        rare = (hydra == 0.0).mean(axis=0) ** 4 + 1e-8
        parts = rocket.mean(axis=0), rocket.std(axis=0) + 1e-6, hydra.mean(axis=0), hydra.std(axis=0) + rare
        return cls(*(part.astype(np.float32) for part in parts))

    def __call__(self, rocket: Float32Array, hydra: Float32Array) -> Float32Array:
        """Return all features scaled, side by side, (n, F)."""
        counts = (hydra - self.hydra_centre) * (hydra != 0.0) / self.hydra_scale
        return np.concatenate([(rocket - self.rocket_centre) / self.rocket_scale, counts], axis=1)


@dataclass(frozen=True)
class RocketWithHydra:
    """A trained MultiRocket with Hydra.

    transforms: of the TV's and of the UV's stream. mean, sd: (2, 6), of the components of the streams, which are
    standardised by them.
    """

    transforms: tuple[Transforms, Transforms]
    mean: Array
    sd: Array
    scaling: Scaling
    ridge: Ridge

    def decide(self, windows: Windows) -> Array:
        """Return the values of the ridge, (n, G)."""
        streams = standardised(windows, self.mean, self.sd)
        return self.ridge.decide(self.scaling(*transformed(self.transforms, streams)))


def fit_rocket(windows: Windows, label: IntArray, settings: MultirocketHydraSettings, seed: int) -> RocketWithHydra:
    """Fit to windows with labels (n,), classes weighted by inverse frequency."""
    mean, sd = stream_scale(windows)
    scaled = standardised(windows, mean, sd)
    tv, uv = (fitted_to(x, settings.features // (2 * 2 * POOLINGS), settings.groups, seed % 2**31) for x in scaled)
    features = transformed((tv, uv), scaled)
    scaling = Scaling.of(*features)
    return RocketWithHydra((tv, uv), mean, sd, scaling, fit_ridge(scaling(*features), label))


def fitted_to(x: Float32Array, kernels: int, groups: int, seed: int = 0) -> Transforms:
    """Return transforms fitted to standardised streams (n, 6, T). kernels: of MultiRocket, in each representation."""
    library = importlib.import_module("aeon.transformations.collection.convolution_based")
    with torch_left_alone():
        rocket = library.MultiRocket(n_kernels=kernels, random_state=seed).fit(x)
        hydra = library.HydraTransformer(GROUP_KERNELS, groups, random_state=seed, output_type="numpy").fit(x)
    return Transforms(rocket, hydra)


@contextmanager
def torch_left_alone() -> Iterator[None]:
    """Keep torch's random state and number of threads, which aeon sets."""
    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def transformed(
    transforms: tuple[Transforms, Transforms], streams: tuple[Float32Array, Float32Array]
) -> tuple[Float32Array, Float32Array]:
    """Return MultiRocket's and Hydra's features of both streams, each (n, F)."""
    pairs = [transform(x) for transform, x in zip(transforms, streams, strict=True)]
    rocket, hydra = (np.concatenate(parts, axis=1) for parts in zip(*pairs, strict=True))
    return rocket, hydra


def write_rocket(rocket: RocketWithHydra, path: Path) -> None:
    """Write a trained MultiRocket with Hydra as plain arrays."""
    arrays = {"mean": rocket.mean, "sd": rocket.sd} | vars(rocket.scaling) | vars(rocket.ridge)
    for k, transforms in enumerate(rocket.transforms):
        for name, parts in (("stream", transforms.rocket.parameter), ("differences", transforms.rocket.parameter1)):
            arrays |= {f"{name}_{part}_{k}": value for part, value in zip(PARTS, parts, strict=True)}
        network = transforms.hydra._hydra  # aeon has no public name for the kernels
        arrays[f"hydra_kernels_{k}"] = network.W.numpy()
        arrays[f"hydra_channels_{k}"] = torch.stack(network.idx).numpy()
    np.savez_compressed(path, **arrays)


def read_rocket(path: Path, lengths: tuple[int, int]) -> RocketWithHydra:
    """Read what `write_rocket` wrote.

    lengths: samples per window of the TV's and of the UV's stream.
    Raises ValueError or LookupError if the file holds anything else.
    """
    arrays = read_arrays(path)
    check_scale(arrays)
    for name in (part.name for part in fields(Scaling)):
        check_array(arrays, name, "f", (None,))
        if name.endswith("scale") and (arrays[name] <= 0).any():
            raise ValueError(f"{name}: is not positive")
    tv, uv = (_read_transforms(arrays, k, length) for k, length in enumerate(lengths))
    scaling = Scaling(*(arrays.pop(part.name) for part in fields(Scaling)))
    sizes = {part.name: len(getattr(scaling, part.name)) for part in fields(Scaling)}
    if (sizes["rocket_centre"], sizes["hydra_centre"]) != (sizes["rocket_scale"], sizes["hydra_scale"]):
        raise ValueError("rocket_scale or hydra_scale: has another length than its centre")
    ridge = read_ridge(arrays, sizes["rocket_centre"] + sizes["hydra_centre"])
    still = tuple(np.zeros((1, N_STATES, length), np.float32) for length in lengths)
    widths = tuple(features.shape[1] for features in transformed((tv, uv), (still[0], still[1])))
    if widths != (sizes["rocket_centre"], sizes["hydra_centre"]):
        raise ValueError("rocket_centre or hydra_centre: is not of the features of the transforms")
    return RocketWithHydra((tv, uv), **arrays, scaling=scaling, ridge=ridge)


def _read_transforms(arrays: dict[str, Any], k: int, length: int) -> Transforms:
    """Take the transforms of stream k, of `length` samples, out of the arrays of a file."""
    stream, differences = (
        tuple(arrays.pop(f"{name}_{part}_{k}") for part in PARTS) for name in ("stream", "differences")
    )
    check(stream, length)
    check(differences, length - 1)
    kernels, channels = arrays.pop(f"hydra_kernels_{k}"), arrays.pop(f"hydra_channels_{k}")
    groups = HALVES * channels.shape[2]
    # aeon has no other way to make fitted transforms: fit to any varying input, then replace what was drawn.
    transforms = fitted_to(np.tile(np.arange(length, dtype=np.float32), (2, N_STATES, 1)), KERNELS, groups)
    transforms.rocket.parameter, transforms.rocket.parameter1 = stream, differences
    network = transforms.hydra._hydra
    like = (tuple(network.W.shape), (len(network.idx), *network.idx[0].shape))
    if (kernels.shape, channels.shape) != like or kernels.dtype != np.float32 or channels.dtype != np.int64:
        raise ValueError("not the kernels of a Hydra transform")
    if not 0 <= channels.min() <= channels.max() < N_STATES:
        raise ValueError("not the channels of a Hydra transform")
    network.W, network.idx = torch.from_numpy(kernels), list(torch.from_numpy(channels))
    return transforms
