"""What every network of the project has in common: standardised windows in, features, logits out."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from models.predictors.losses import focal_loss

N_STATES = 6


class WindowNetwork(nn.Module):
    """A network over both streams of a window. Subclasses turn standardised streams into features in `encode`, and set
    `head`, which reads logits from the features.
    Inputs are windows as cut, in m, m/s and m/s2; the standardisation is part of the network (see `fit_scale`).
    """

    tv_mean: Tensor
    tv_sd: Tensor
    uv_mean: Tensor
    uv_sd: Tensor
    head: nn.Module

    def __init__(self, n_classes: int) -> None:
        super().__init__()
        self.n_classes = n_classes
        for stream in ("tv", "uv"):
            self.register_buffer(f"{stream}_mean", torch.zeros(N_STATES, 1))
            self.register_buffer(f"{stream}_sd", torch.ones(N_STATES, 1))

    def fit_scale(self, tv: Tensor, uv: Tensor) -> None:
        """Take channel means and standard deviations from training windows (n, 6, T) and (n, 6, U); they are saved with
        the weights.
        """
        scale = [(x.double().mean(dim=(0, 2)), x.double().std(dim=(0, 2), correction=0) + 1e-6) for x in (tv, uv)]
        self.set_scale(*scale[0], *scale[1])

    def set_scale(self, tv_mean: Tensor, tv_sd: Tensor, uv_mean: Tensor, uv_sd: Tensor) -> None:
        """Channel means and standard deviations of training windows, each (6,); they are saved with the weights."""
        for name, value in (("tv_mean", tv_mean), ("tv_sd", tv_sd), ("uv_mean", uv_mean), ("uv_sd", uv_sd)):
            getattr(self, name).copy_(value[:, None])

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Features (B, width) of standardised streams (B, 6, T) and (B, 6, U)."""
        raise NotImplementedError

    def standardised(self, tv: Tensor, uv: Tensor) -> tuple[Tensor, Tensor]:
        """Windows by the scale of training windows; shapes are kept."""
        return (tv - self.tv_mean) / self.tv_sd, (uv - self.uv_mean) / self.uv_sd

    def features(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Features (B, width) of windows (B, 6, T) and (B, 6, U)."""
        return self.encode(*self.standardised(tv, uv))

    def classify(self, features: Tensor) -> Tensor:
        """Logits (B, n_classes) of features."""
        return torch.as_tensor(self.head(features))

    def forward(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Logits (B, n_classes) of windows (B, 6, T) and (B, 6, U)."""
        return self.classify(self.features(tv, uv))

    def answers(self, tv: Tensor, uv: Tensor) -> dict[str, Tensor]:
        """All logits that training looks at, (B, n_classes) each; `joint` is the network's answer."""
        return {"joint": self(tv, uv)}

    def loss(self, said: dict[str, Tensor], label: Tensor, weight: Tensor | None, gamma: float) -> Tensor:
        """What training lowers, of `answers` and labels (B,): the focal loss.

        weight: of the classes, (n_classes,), if any. gamma: the focusing parameter.
        """
        return focal_loss(said["joint"].float(), label, weight, gamma)

    @property
    def parameter_count(self) -> int:
        """Trained numbers."""
        return sum(each.numel() for each in self.parameters())


def linear_head(width: int, n_classes: int, dropout: float) -> nn.Module:
    """Dropout and one linear layer."""
    return nn.Sequential(nn.Dropout(dropout), nn.Linear(width, n_classes))
