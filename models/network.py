"""What every network of the project has in common: standardised windows in, features, logits out."""

from __future__ import annotations

import torch
from torch import Tensor, nn

N_STATES = 6


class WindowNetwork(nn.Module):
    """A network over both streams of a window. Subclasses turn standardised streams into features in `encode`.

    Inputs are windows as cut, in m, m/s and m/s2; the standardisation is part of the network (see `set_scale`).
    """

    tv_mean: Tensor
    tv_sd: Tensor
    uv_mean: Tensor
    uv_sd: Tensor

    def __init__(self, n_classes: int, width: int, dropout: float) -> None:
        super().__init__()
        self.n_classes = n_classes
        for stream in ("tv", "uv"):
            self.register_buffer(f"{stream}_mean", torch.zeros(N_STATES, 1))
            self.register_buffer(f"{stream}_sd", torch.ones(N_STATES, 1))
        self.head = nn.Sequential(nn.Dropout(dropout), nn.Linear(width, n_classes))

    def set_scale(self, tv_mean: Tensor, tv_sd: Tensor, uv_mean: Tensor, uv_sd: Tensor) -> None:
        """Channel means and standard deviations of training windows, each (6,); they are saved with the weights."""
        for name, value in (("tv_mean", tv_mean), ("tv_sd", tv_sd), ("uv_mean", uv_mean), ("uv_sd", uv_sd)):
            getattr(self, name).copy_(value[:, None])

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Features (B, width) of standardised streams (B, 6, T) and (B, 6, U)."""
        raise NotImplementedError

    def features(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Features (B, width) of windows (B, 6, T) and (B, 6, U)."""
        return self.encode((tv - self.tv_mean) / self.tv_sd, (uv - self.uv_mean) / self.uv_sd)

    def classify(self, features: Tensor) -> Tensor:
        """Logits (B, n_classes) of features."""
        return torch.as_tensor(self.head(features))

    def forward(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Logits (B, n_classes) of windows (B, 6, T) and (B, 6, U)."""
        return self.classify(self.features(tv, uv))
