"""The three modules of CaSTFormer: reciprocal shift fusion, causal pattern extraction, feature synthesis.

All of them map whole sequences (B, T, D) to sequences, and none lets a frame see a later one, so they can follow each
other in any order. CaSTFormer reads the last frame, so only that one is computed once no later module reads the others.
`inner` and `outer` are the paper's `in` and `out` streams.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn

Attention = Literal["bda", "self", "joint", "one_way"]
Source = Literal["in", "out"]
MeanOver = Literal["window", "batch"]
EPSILON = 1e-6
"""Keeps norms and quotients finite."""
MOMENTUM = 0.1
"""Share of a training batch in the running average of batch means, as in batch normalisation."""


@dataclass(frozen=True)
class State:
    """What one module hands to the next: sequences (B, T, D), unless stated otherwise.

    context: the interaction branch, after feature synthesis. intent: logits of the coarse intention, (B, T, M), and
    token, its embedding, after causal pattern extraction. speed: (B, T, 1), if there is one.
    """

    inner: Tensor
    outer: Tensor
    speed: Tensor | None = None
    context: Tensor | None = None
    intent: Tensor | None = None
    token: Tensor | None = None

    def last(self) -> State:
        """Return the state at the last frame only: sequences (B, 1, D)."""
        optional = (self.speed, self.context, self.intent, self.token)
        return State(self.inner[:, -1:], self.outer[:, -1:], *(None if x is None else x[:, -1:] for x in optional))


def shifted(x: Tensor, frames: int) -> Tensor:
    """Return a sequence (B, T, D) delayed by a number of frames, with zeros in front. Source: Eq. (1)."""
    if frames == 0:
        return x
    return torch.cat((torch.zeros_like(x[:, :frames]), x[:, : x.shape[1] - frames]), dim=1)


def delayed_mask(length: int, frames: int, device: torch.device | None = None) -> Tensor:
    """Return which delayed keys are hidden from each query, (T, T), True for hidden.

    Query t sees the original frames up to t - `frames`. The zeros in front are hidden from all but the first queries,
    which would otherwise see nothing at all.
    """
    query = torch.arange(length, device=device)[:, None]
    key = torch.arange(length, device=device)[None, :]
    visible = ((key >= frames) & (key <= query)) | ((query < frames) & (key == 0))
    return ~visible


def running_mean(x: Tensor, frames: int) -> Tensor:
    """Return the mean of the delayed keys that each query sees, (B, T, D), of a stream (B, T, D)."""
    total = shifted(x, frames).cumsum(dim=1)
    count = torch.arange(1, x.shape[1] + 1, device=x.device) - frames
    return total / count.clamp(min=1).to(x.dtype)[:, None]


class DelayedAttention(nn.Module):
    """Multi-head attention to keys that are delayed by a number of frames, Eq. (2)."""

    def __init__(self, width: int, heads: int, dropout: float, frames: int) -> None:
        super().__init__()
        self.frames = frames
        self.attention = nn.MultiheadAttention(width, heads, dropout, batch_first=True)

    def forward(self, query: Tensor, *streams: Tensor) -> Tensor:
        """Return (B, Q, D) for queries (B, Q, D) of the last Q frames, and one or more streams of keys (B, T, D)."""
        mask = delayed_mask(streams[0].shape[1], self.frames, query.device)[-query.shape[1] :]
        keys = torch.cat([shifted(x, self.frames) for x in streams], dim=1)
        out = self.attention(query, keys, keys, attn_mask=mask.repeat(1, len(streams)), need_weights=False)[0]
        return torch.as_tensor(out)

    def uniform(self, mean: Tensor) -> Tensor:
        """Return the output of the attention if every key were `mean`, (B, T, D).

        Equal keys get weights that sum to 1, whatever the query, so only the value and output projections remain.
        """
        width = mean.shape[-1]
        value = nn.functional.linear(
            mean, self.attention.in_proj_weight[2 * width :], self.attention.in_proj_bias[2 * width :]
        )
        return torch.as_tensor(self.attention.out_proj(value))


class ChannelGate(nn.Module):
    """Two gating layers over channels, a root-mean-square norm and dropout: Eq. (3) to (5)."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.gate = nn.Sequential(nn.Linear(width, width), nn.ReLU(), nn.Linear(width, width), nn.Sigmoid())
        self.norm = nn.RMSNorm(width, EPSILON)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        """Return a gated sequence, (B, T, D), of one of the same shape."""
        return torch.as_tensor(self.dropout(self.norm(self.gate(x) * x)))


class ReciprocalShiftFusion(nn.Module):
    """RSF: each stream attends to the past that the attention design names, then its channels are gated."""

    def __init__(
        self, width: int, heads: int, dropout: float, frames: int, attention: Attention, residual: bool
    ) -> None:
        super().__init__()
        self.design, self.residual = attention, residual
        self.attend = nn.ModuleList(DelayedAttention(width, heads, dropout, frames) for _ in range(2))
        self.gate = nn.ModuleList(ChannelGate(width, dropout) for _ in range(2))

    def forward(self, state: State, past: State) -> State:
        """Return the state with both streams fused. past: all frames; those of `state` are the last of them."""
        fused = []
        for k, stream in enumerate((state.inner, state.outer)):
            x = self.gate[k](self.attend[k](stream, *self._keys(k, past)))
            fused.append(stream + x if self.residual else x)
        return State(fused[0], fused[1], state.speed, state.context, state.intent, state.token)

    def _keys(self, k: int, past: State) -> tuple[Tensor, ...]:
        """Return the streams that the k-th stream attends to; 0 is `inner`, 1 is `outer`."""
        stream, other = (past.inner, past.outer) if k == 0 else (past.outer, past.inner)
        if self.design == "joint":
            return stream, other
        to_itself = self.design == "self" or (self.design == "one_way" and k == 1)
        return (stream,) if to_itself else (other,)


class CausalResidual(nn.Module):
    """What attention to the other stream adds over attention to that stream's mean: Eq. (6) to (8).

    mean_over: `window`: the frames that a query sees, so that an answer does not depend on other windows; `batch`: all
    frames of all windows of a training batch, as in the paper. Predictions then use the running average of these.
    """

    usual: Tensor

    def __init__(
        self, width: int, heads: int, dropout: float, frames: int, detach_mean: bool, mean_over: MeanOver = "window"
    ) -> None:
        super().__init__()
        self.detach_mean, self.mean_over = detach_mean, mean_over
        if mean_over == "batch":
            self.register_buffer("usual", torch.zeros(width))
        self.attend = DelayedAttention(width, heads, dropout, frames)
        self.gate = nn.Linear(width, 1)

    def forward(self, stream: Tensor, other: Tensor) -> Tensor:
        """Return the last Q frames of a stream, (B, Q, D), with their gated residuals; other: (B, T, D)."""
        residual = self.residual(stream, other)
        return stream + torch.sigmoid(self.gate(residual)) * residual

    def residual(self, stream: Tensor, other: Tensor) -> Tensor:
        """Return observed minus counterfactual attention, made orthogonal to the other stream's mean, (B, Q, D)."""
        mean = self.mean(other)[:, -stream.shape[1] :]
        delta = self.attend(stream, other) - self.counterfactual(mean)
        share = (delta * mean).sum(dim=-1, keepdim=True) / (mean.square().sum(dim=-1, keepdim=True) + EPSILON)
        return torch.as_tensor(delta - share * mean)

    def mean(self, other: Tensor) -> Tensor:
        """Return the mean of the other stream for each query, (B, T, D); in training, follow that of the batches."""
        if self.mean_over == "window":
            return running_mean(other, self.attend.frames)
        mean = self.usual
        if self.training:
            mean = other.mean(dim=(0, 1))
            self.usual.lerp_(mean.detach(), MOMENTUM)
        return mean.expand_as(other)

    def counterfactual(self, mean: Tensor) -> Tensor:
        """Return the attention if the other stream had always been its mean, (B, T, D)."""
        return self.attend.uniform(mean.detach() if self.detach_mean else mean)


class CausalPatternExtraction(nn.Module):
    """CPE: gated causal residuals, and the coarse intention as a token: Eq. (6) to (9).

    Later modules use the token; if features are synthesised already, it is added to their context.
    inner, outer: the residuals of the two streams.
    """

    def __init__(
        self, inner: CausalResidual, outer: CausalResidual, width: int, n_classes: int, source: Source
    ) -> None:
        super().__init__()
        self.source = source
        self.inner, self.outer = inner, outer
        self.classify = nn.Linear(width, n_classes, bias=False)
        self.embed = nn.Linear(n_classes, width, bias=False)

    def forward(self, state: State, past: State) -> State:
        """Return the state with causal streams, coarse intention and token. past: all frames, as in RSF."""
        inner, outer = self.inner(state.inner, past.outer), self.outer(state.outer, past.inner)
        intent = self.classify(inner if self.source == "in" else outer)
        token = self.embed(intent.softmax(dim=-1))
        context = None if state.context is None else state.context + token
        return State(inner, outer, state.speed, context, intent, token)


class FeatureSynthesis(nn.Module):
    """FSN: the residual branches of Eq. (10). Their confidence weights are in `Confidence`.

    token, speed: whether the state has an intention token and a speed.
    """

    def __init__(self, width: int, hidden: int, token: bool, speed: bool) -> None:
        super().__init__()
        self.token, self.speed = token, speed
        widths = width * (1 + token), width * (1 + token) + speed, width * (2 + token) + speed
        self.inner, self.outer, self.context = (
            nn.Sequential(nn.Linear(n, hidden), nn.ReLU(), nn.Linear(hidden, width)) for n in widths
        )

    def forward(self, state: State, _: State) -> State:
        """Return the state with the three branches of synthesised features, frame by frame."""
        token = [state.token] if self.token and state.token is not None else []
        speed = [state.speed] if self.speed and state.speed is not None else []
        inner, outer = state.inner, state.outer
        r_in = self.inner(torch.cat([inner, *token], dim=-1)) + inner
        r_out = self.outer(torch.cat([outer, *token, *speed], dim=-1)) + outer
        r_ctx = self.context(torch.cat([inner, outer, *token, *speed], dim=-1)) + inner + outer
        return State(r_in, r_out, state.speed, r_ctx, state.intent, state.token)


class Confidence(nn.Module):
    """The logits of the three branches, and their sum weighted by confidence: Eq. (11)."""

    def __init__(self, width: int, n_classes: int, dropout: float) -> None:
        super().__init__()
        self.dropout = nn.Dropout(dropout)
        self.classify = nn.ModuleList(nn.Linear(width, n_classes) for _ in range(3))
        self.confidence = nn.ModuleList(nn.Linear(width, 1, bias=False) for _ in range(3))

    def branches(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (B, 3, M) and weights (B, 3) of features (B, 3 D): inner, outer, context."""
        parts = self.dropout(features).chunk(3, dim=-1)
        logits = torch.stack([layer(x) for layer, x in zip(self.classify, parts, strict=True)], dim=1)
        score = torch.cat([layer(x) for layer, x in zip(self.confidence, parts, strict=True)], dim=1)
        return logits, score.softmax(dim=1)

    def forward(self, features: Tensor) -> Tensor:
        """Return joint logits (B, M) of features (B, 3 D)."""
        logits, weight = self.branches(features)
        return joint(logits, weight)


def joint(logits: Tensor, weight: Tensor) -> Tensor:
    """Return the weighted sum (B, M) of branch logits (B, 3, M) with weights (B, 3). Source: Eq. (11)."""
    return (weight[:, :, None] * logits).sum(dim=1)
