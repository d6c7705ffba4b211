"""InceptionTime: convolutions of several lengths side by side, the usual strong network for series of any kind.

Both streams are interpolated to one rate and stacked. InceptionTime proper is the mean of five such networks with
different initial weights; this is one of them, so that it is compared with one network of the others.
Source: Ismail Fawaz et al. 2020, "InceptionTime: Finding AlexNet for time series classification".
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import torch
from pydantic import Field
from torch import Tensor, nn

from isac_cosim.base.settings import Settings
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.networks.network import LONGEST, MOST_LAYERS, N_STATES, WindowNetwork, linear_head
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import WindowShape

MODULES_PER_SHORTCUT = 3
"""A residual connection skips this many modules."""


class InceptionTimeSettings(Settings):
    """Sizes of the network; the defaults are the paper's."""

    length: int = Field(
        220, ge=2, le=LONGEST, description="samples per window after interpolation; 220 in 2.2 s are 100 Hz"
    )
    filters: int = Field(32, ge=1, le=65_536, description="filters of each convolution; a module has four in parallel")
    depth: int = Field(6, ge=1, le=MOST_LAYERS, description="modules, one after the other")
    kernels: tuple[Annotated[int, Field(ge=1, le=LONGEST)], ...] = Field(
        (39, 19, 9), min_length=1, max_length=MOST_LAYERS, description="lengths of the convolutions, odd, samples"
    )
    dropout: float = Field(0.0, ge=0, lt=1, description="dropout before the head")


class InceptionModule(nn.Module):
    """Convolutions of several lengths, and a pooled copy, over a bottleneck; batch-normalised and rectified."""

    def __init__(self, channels: int, settings: InceptionTimeSettings) -> None:
        super().__init__()
        filters = settings.filters
        self.bottleneck = nn.Conv1d(channels, filters, 1, bias=False)
        self.convolutions = nn.ModuleList(
            nn.Conv1d(filters, filters, kernel, padding="same", bias=False) for kernel in settings.kernels
        )
        self.pooled = nn.Sequential(nn.MaxPool1d(3, stride=1, padding=1), nn.Conv1d(channels, filters, 1, bias=False))
        self.norm = nn.BatchNorm1d(filters * (len(settings.kernels) + 1))

    def forward(self, x: Tensor) -> Tensor:
        """Return (B, filters (kernels + 1), T) for (B, channels, T)."""
        narrow = self.bottleneck(x)
        parts = [*(convolution(narrow) for convolution in self.convolutions), self.pooled(x)]
        return torch.relu(self.norm(torch.cat(parts, dim=1)))


class InceptionNetwork(WindowNetwork):
    """The network: streams interpolated to `length` samples, modules with shortcuts, mean over time, linear head.

    The streams' last samples coincide; their first ones are less than one sample apart.
    """

    def __init__(self, settings: InceptionTimeSettings, n_classes: int) -> None:
        super().__init__(n_classes)
        self.settings = settings
        width = settings.filters * (len(settings.kernels) + 1)
        widths = [2 * N_STATES, *[width] * settings.depth]
        self.blocks = nn.ModuleList(InceptionModule(channels, settings) for channels in widths[:-1])
        self.shortcuts = nn.ModuleList(
            nn.Sequential(nn.Conv1d(widths[first], width, 1, bias=False), nn.BatchNorm1d(width))
            for first in range(0, settings.depth - MODULES_PER_SHORTCUT + 1, MODULES_PER_SHORTCUT)
        )
        self.head = linear_head(width, n_classes, settings.dropout)

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return the last module's mean over time, (B, width), of standardised streams (B, 6, T) and (B, 6, U)."""
        size = self.settings.length
        x = torch.cat(
            [nn.functional.interpolate(stream, size, mode="linear", align_corners=True) for stream in (tv, uv)], dim=1
        )
        kept = x
        for number, module in enumerate(self.blocks, start=1):
            x = module(x)
            if number % MODULES_PER_SHORTCUT == 0:
                x = torch.relu(x + self.shortcuts[number // MODULES_PER_SHORTCUT - 1](kept))
                kept = x
        return torch.as_tensor(x.mean(dim=2))


class InceptionTimePredictor(NetworkPredictor):
    """One network of InceptionTime as a predictor."""

    display_name = "InceptionTime"
    summary = "both streams at one rate, one InceptionTime network"
    settings_class: ClassVar[type[Settings] | None] = InceptionTimeSettings
    window_s = 17e-3

    @classmethod
    def build(cls, settings: FitSettings, shape: WindowShape) -> WindowNetwork:
        return InceptionNetwork(settings.of(InceptionTimeSettings), shape.n_classes)
