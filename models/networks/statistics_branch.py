"""The statistics of a window inside a network: extensions of ASI-BIP that show it what the boosted trees see."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from isac_cosim.models.data.statistics import N_RECENT, STATISTICS, recent_motion
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.networks.network import N_STATES


class ColumnsBranch(nn.Module):
    """An MLP on columns that are computed from streams, standardised by those of training windows.

    count: how many columns. mlp: takes them.
    """

    mean: Tensor
    sd: Tensor

    def __init__(self, count: int, mlp: nn.Module) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(count))
        self.register_buffer("sd", torch.ones(count))
        self.mlp = mlp

    def columns(self, *streams: Tensor) -> Tensor:
        """Return the columns, (B, count), of streams (B, 6, T)."""
        raise NotImplementedError

    def fit_scale(self, *streams: Tensor) -> None:
        """Set the scale to the columns of training windows, (n, 6, T) for each stream."""
        columns = self.columns(*streams)
        self.mean.copy_(columns.mean(dim=0))
        self.sd.copy_(columns.std(dim=0, correction=0) + 1e-6)

    def forward(self, *streams: Tensor) -> Tensor:
        """Return (B, width) for streams (B, 6, T)."""
        return torch.as_tensor(self.mlp((self.columns(*streams) - self.mean) / self.sd))


class StatisticsBranch(ColumnsBranch):
    """An MLP on the statistics of one or more streams of a window.

    streams: how many streams. hidden: hidden units. width: of the output. dropout: before the output layer.
    """

    def __init__(self, streams: int, hidden: int, width: int, dropout: float) -> None:
        count = streams * N_STATES * len(STATISTICS)
        super().__init__(
            count, nn.Sequential(nn.Linear(count, hidden), nn.GELU(), nn.Dropout(dropout), nn.Linear(hidden, width))
        )

    def columns(self, *streams: Tensor) -> Tensor:
        return window_statistics(*streams)


class RecentMotionBranch(ColumnsBranch):
    """An MLP on how the TV has moved most lately: the columns of `models.data.statistics.recent_motion`.

    length: samples per window of the TV. rate_hz: of its stream. width: of the output.
    """

    weights: Tensor

    def __init__(self, length: int, rate_hz: float, width: int) -> None:
        super().__init__(N_RECENT, nn.Sequential(nn.Linear(N_RECENT, width), nn.GELU(), nn.Linear(width, width)))
        # The columns are linear in the samples, and the same for each component: their weights answer unit impulses.
        impulses = np.zeros((length, N_STATES, length), np.float32)
        impulses[:, 2] = np.eye(length, dtype=np.float32)
        columns = recent_motion(Windows(impulses, impulses[:, :, :1]), rate_hz)
        self.register_buffer("weights", torch.from_numpy(columns[:, : N_RECENT // (N_STATES - 2)].copy()))

    def columns(self, *streams: Tensor) -> Tensor:
        [tv] = streams
        return (tv[:, 2:] @ self.weights).flatten(1)


def window_statistics(*streams: Tensor) -> Tensor:
    """Return `models.data.statistics.statistics` of streams (B, 6, T) in torch, 60 columns for each stream."""
    return torch.cat([_of_stream(x) for x in streams], dim=1)


def _of_stream(x: Tensor) -> Tensor:
    """Return the statistics of a stream (B, 6, T), component by component, (B, 60)."""
    count = x.shape[2]
    t = torch.arange(count, dtype=x.dtype, device=x.device) - (count - 1) / 2
    # Like numpy's array_split, this makes the first thirds longer by one if three does not divide the window.
    thirds = [part.mean(dim=2) for part in torch.tensor_split(x, 3, dim=2)]
    parts = [
        x.mean(dim=2), x.std(dim=2, correction=0), x.amin(dim=2), x.amax(dim=2), x[..., 0], x[..., -1],
        x @ t / (t @ t), *thirds,
    ]  # fmt: skip
    return torch.stack(parts, dim=2).flatten(1)
