"""Aligned fusion: both streams at one rate in one LSTM, the design that ASI-BIP claims to beat."""

from __future__ import annotations

from typing import ClassVar

import torch
from pydantic import Field
from torch import Tensor, nn

from isac_cosim.base.settings import Settings
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.networks.lstms import outputs
from isac_cosim.models.networks.network import LONGEST, MOST_LAYERS, N_STATES, WindowNetwork, linear_head
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import WindowShape


class AlignedSettings(Settings):
    """One bidirectional LSTM over both streams, interpolated to one rate."""

    length: int = Field(
        220, ge=2, le=LONGEST, description="samples per window after interpolation; 220 in 2.2 s are 100 Hz"
    )
    hidden: int = Field(64, ge=1, le=65_536, description="units per LSTM direction")
    layers: int = Field(1, ge=1, le=MOST_LAYERS, description="LSTM layers")
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout before the head")


class Aligned(WindowNetwork):
    """The network: streams interpolated to `length` samples, one Bi-LSTM, mean over time, linear head.

    The streams' last samples coincide; their first ones are less than one sample apart.
    """

    def __init__(self, settings: AlignedSettings, n_classes: int) -> None:
        super().__init__(n_classes)
        self.head = linear_head(2 * settings.hidden, n_classes, settings.dropout)
        self.settings = settings
        self.lstm = nn.LSTM(2 * N_STATES, settings.hidden, settings.layers, bidirectional=True)

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return the mean LSTM output, (B, 2 hidden), of standardised streams (B, 6, T) and (B, 6, U)."""
        size = self.settings.length
        both = [nn.functional.interpolate(x, size, mode="linear", align_corners=True) for x in (tv, uv)]
        return outputs([self.lstm], [torch.cat(both, dim=1).permute(2, 0, 1)])[0].mean(dim=0)


class AlignedPredictor(NetworkPredictor):
    """Aligned fusion as a predictor."""

    display_name = "aligned fusion"
    summary = "both streams interpolated to one rate, one bidirectional LSTM"
    settings_class: ClassVar[type[Settings] | None] = AlignedSettings
    window_s = 1.1e-3

    @classmethod
    def build(cls, settings: FitSettings, shape: WindowShape) -> WindowNetwork:
        return Aligned(settings.of(AlignedSettings), shape.n_classes)
