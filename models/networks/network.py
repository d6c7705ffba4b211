"""The base class of all networks: windows go in, are standardised, and become features and logits."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from isac_cosim.base import seeding
from isac_cosim.models.networks.losses import focal_loss

N_STATES = 6
"""Components of a state: x, y, vx, vy, ax, ay."""
MOST_LAYERS = 64
"""Largest number of layers of a network, one after or beside the other."""
LONGEST = 20_000
"""Largest number of samples or frames that a network may be set to look at, or a convolution may be long."""


def torch_seed(*keys: str | int) -> int:
    """Return a seed for torch's own generator; keys name its purpose, as for `base.seeding.stream`."""
    return int(seeding.stream("torch", *keys).integers(2**62))


def seed_weights(seed: int) -> None:
    """Seed torch for the initial weights of a network; call it before the network is built."""
    torch.manual_seed(torch_seed("weights", seed))


class WindowNetwork(nn.Module):
    """A network over both streams of a window.

    A subclass implements `encode`, which turns standardised streams into features, and sets `head`, which turns
    features into logits. Inputs are windows as they are cut, in m, m/s and m/s2; their standardisation is part of the
    network (see `fit_scale`), and is saved with the weights.
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
        """Set the scale to the means and standard deviations of training windows (n, 6, T) and (n, 6, U)."""
        scale = [(x.double().mean(dim=(0, 2)), x.double().std(dim=(0, 2), correction=0) + 1e-6) for x in (tv, uv)]
        self.set_scale(*scale[0], *scale[1])

    def set_scale(self, tv_mean: Tensor, tv_sd: Tensor, uv_mean: Tensor, uv_sd: Tensor) -> None:
        """Set the mean and standard deviation of each component of the streams, each (6,)."""
        for name, value in (("tv_mean", tv_mean), ("tv_sd", tv_sd), ("uv_mean", uv_mean), ("uv_sd", uv_sd)):
            getattr(self, name).copy_(value[:, None])

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return features (B, width) of standardised streams (B, 6, T) and (B, 6, U)."""
        raise NotImplementedError

    def standardised(self, tv: Tensor, uv: Tensor) -> tuple[Tensor, Tensor]:
        """Return both streams in units of the training windows' scale; shapes are kept."""
        return (tv - self.tv_mean) / self.tv_sd, (uv - self.uv_mean) / self.uv_sd

    def features(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return features (B, width) of windows (B, 6, T) and (B, 6, U)."""
        return self.encode(*self.standardised(tv, uv))

    def classify(self, features: Tensor) -> Tensor:
        """Return logits (B, n_classes) of features (B, width)."""
        return torch.as_tensor(self.head(features))

    def forward(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return logits (B, n_classes) of windows (B, 6, T) and (B, 6, U)."""
        return self.classify(self.features(tv, uv))

    def training_logits(self, tv: Tensor, uv: Tensor) -> dict[str, Tensor]:
        """Return all logits that the loss depends on, (B, n_classes) each; `joint` is the network's answer."""
        return {"joint": self(tv, uv)}

    def loss(self, logits: dict[str, Tensor], label: Tensor, weight: Tensor | None, gamma: float) -> Tensor:
        """Return the loss that training minimises, a scalar; here the focal loss of the joint logits.

        logits: what `training_logits` returned. label: (B,). weight: of the classes, (n_classes,), all 1 if None.
        gamma: focusing parameter.
        """
        return focal_loss(logits["joint"].float(), label, weight, gamma)

    @property
    def parameter_count(self) -> int:
        """How many numbers are trained."""
        return sum(parameter.numel() for parameter in self.parameters())

    @property
    def lstm_precision(self) -> str | None:
        """In which precision LSTMs are trained where the network is now; None if that is no setting of the network."""
        return None


def linear_head(width: int, n_classes: int, dropout: float) -> nn.Module:
    """Return a head of dropout and one linear layer."""
    return nn.Sequential(nn.Dropout(dropout), nn.Linear(width, n_classes))
