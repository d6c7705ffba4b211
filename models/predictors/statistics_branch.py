"""Statistics of a window inside a network: an extension of ASI-BIP that gives it what the boosted trees see."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from models.predictors.floors import STATISTICS
from models.predictors.network import N_STATES


class StatisticsBranch(nn.Module):
    """An MLP over the statistics of `streams` streams of a window, standardised by those of training windows."""

    mean: Tensor
    sd: Tensor

    def __init__(self, streams: int, hidden: int, width: int, dropout: float) -> None:
        super().__init__()
        count = streams * N_STATES * len(STATISTICS)
        self.register_buffer("mean", torch.zeros(count))
        self.register_buffer("sd", torch.ones(count))
        self.mlp = nn.Sequential(nn.Linear(count, hidden), nn.GELU(), nn.Dropout(dropout), nn.Linear(hidden, width))

    def fit_scale(self, *streams: Tensor) -> None:
        """Take means and standard deviations from the statistics of training windows, (n, 6, T) of each stream."""
        found = window_statistics(*streams)
        self.mean.copy_(found.mean(dim=0))
        self.sd.copy_(found.std(dim=0, correction=0) + 1e-6)

    def forward(self, *streams: Tensor) -> Tensor:
        """(B, width) of streams (B, 6, T)."""
        return torch.as_tensor(self.mlp((window_statistics(*streams) - self.mean) / self.sd))


def window_statistics(*streams: Tensor) -> Tensor:
    """`models.predictors.floors.statistics` of streams (B, 6, T), (B, 60 for each stream), as a network needs them."""
    return torch.cat([_of_stream(x) for x in streams], dim=1)


def _of_stream(x: Tensor) -> Tensor:
    """(B, 60) of (B, 6, T), component by component."""
    count = x.shape[2]
    t = torch.arange(count, dtype=x.dtype, device=x.device) - (count - 1) / 2
    # Thirds as numpy's array_split makes them: the first ones are longer by one where three does not divide the window.
    thirds = [part.mean(dim=2) for part in torch.tensor_split(x, 3, dim=2)]
    parts = [
        x.mean(dim=2), x.std(dim=2, correction=0), x.amin(dim=2), x.amax(dim=2), x[..., 0], x[..., -1],
        x @ t / (t @ t), *thirds,
    ]  # fmt: skip
    return torch.stack(parts, dim=2).flatten(1)
