"""A convolution over time that never looks ahead: it answers a sequence at once, or one step after the other.

Each layer is a residual block of a dilated causal convolution (Bai, Kolter & Koltun 2018, "An empirical evaluation of
generic convolutional and recurrent networks for sequence modeling", arXiv 1803.01271).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

KERNEL = 4
"""Steps that a convolution looks at, its own included."""
DILATION = 2
"""Factor from the distance of these steps in one layer to that in the next."""


def layers_within(steps: int) -> int:
    """Return the most layers whose receptive field is at most some steps; at least none."""
    layers = 0
    while receptive_field(layers + 1) <= steps:
        layers += 1
    return layers


def receptive_field(layers: int) -> int:
    """Return how many steps an answer depends on, its own included."""
    return 1 + sum(reach(k) for k in range(layers))


def reach(layer: int) -> int:
    """Return how many steps a layer looks back."""
    distance: int = DILATION**layer
    return (KERNEL - 1) * distance


@dataclass
class CausalState:
    """What a network remembers of B sequences: the inputs of each layer that later steps look at, (B, C, reach)."""

    inputs: list[Tensor]

    def of(self, rows: Tensor) -> CausalState:
        """Return the state of some sequences, by their numbers, (m,)."""
        return CausalState([values[rows] for values in self.inputs])


class CausalNetwork(nn.Module):
    """Answers every step of sequences of F features with `outputs` logits.

    The first steps see zeros before the beginning; from the `receptive_field`-th on, an answer depends on the latest
    steps alone.
    """

    mean: Tensor
    sd: Tensor

    def __init__(self, features: int, width: int, layers: int, outputs: int, dropout: float) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("sd", torch.ones(features))
        self.enter = nn.Linear(features, width)
        self.layers = nn.ModuleList(nn.Conv1d(width, width, KERNEL, dilation=DILATION**k) for k in range(layers))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers))
        self.mixing = nn.ModuleList(nn.Linear(width, width) for _ in range(layers))
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Dropout(dropout), nn.Linear(width, outputs))

    @property
    def parameter_count(self) -> int:
        """How many numbers are trained."""
        return sum(parameter.numel() for parameter in self.parameters())

    def fit_scale(self, features: Tensor) -> None:
        """Set the scale of the inputs to the mean and standard deviation of features (n, F)."""
        self.mean.copy_(features.double().mean(dim=0))
        self.sd.copy_(features.double().std(dim=0, correction=0) + 1e-3)

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (B, L, outputs) of sequences (B, L, F)."""
        hidden = self._entered(features)
        for k in range(len(self.layers)):
            inputs = self.norms[k](hidden).transpose(1, 2)
            hidden = self._left(k, hidden, self.layers[k](functional.pad(inputs, (reach(k), 0))).transpose(1, 2))
        return torch.as_tensor(self.head(hidden))

    def begin(self, sequences: int) -> CausalState:
        """Return the state before the first step of some sequences."""
        width = self.enter.out_features
        return CausalState([torch.zeros(sequences, width, reach(k)) for k in range(len(self.layers))])

    def step(self, features: Tensor, state: CausalState) -> tuple[Tensor, CausalState]:
        """Return logits (B, outputs) of the next step of sequences, from features (B, F), and the state after it."""
        hidden = self._entered(features)
        after = []
        for k in range(len(self.layers)):
            inputs = torch.cat([state.inputs[k], self.norms[k](hidden)[:, :, None]], dim=2)
            after.append(inputs[:, :, 1:])
            hidden = self._left(k, hidden, self.layers[k](inputs)[:, :, 0])
        return torch.as_tensor(self.head(hidden)), CausalState(after)

    def _entered(self, features: Tensor) -> Tensor:
        scaled = ((features - self.mean) / self.sd).clamp(-8.0, 8.0)
        return functional.gelu(self.enter(scaled))

    def _left(self, k: int, hidden: Tensor, convolved: Tensor) -> Tensor:
        return torch.as_tensor(hidden + self.dropout(self.mixing[k](functional.gelu(convolved))))
