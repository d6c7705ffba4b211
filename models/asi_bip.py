"""ASI-BIP: asynchronous spatio-temporal interaction behavioural intention prediction (Section III-C of the paper).

Two bidirectional LSTMs run on the streams at their own rates; a Transformer encoder attends over both outputs behind a
learned classification token, from which the intention is read.
"""

from __future__ import annotations

from typing import Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from isacsim.settings import Settings

N_STATES = 6


class AsiBipSettings(Settings):
    """Everything that the paper leaves open about its network."""

    hidden: int = Field(64, ge=1, description="units of one LSTM direction")
    lstm_layers: int = Field(1, ge=1, description="layers of each LSTM")
    width: int = Field(128, ge=1, description="d of the tokens")
    encoder_layers: int = Field(2, ge=1, description="layers of the Transformer encoder")
    heads: int = Field(8, ge=1, description="attention heads")
    feedforward: int = Field(256, ge=1, description="hidden units of the encoder's feed-forward blocks")
    norm_first: bool = Field(True, description="normalise before attention and feed-forward, not after")
    dropout: float = Field(0.1, ge=0, lt=1, description="after projection, attention, feed-forward and before the head")
    attention_dropout: float = Field(0.0, ge=0, lt=1, description="of attention weights; above 0 costs fused attention")
    tokens: Literal["pooled", "literal"] = Field(
        "pooled",
        description="pooled: LSTM outputs are averaged over tv_pool and uv_pool; literal: every output a token",
    )
    tv_pool: int = Field(20, ge=1, description="TV samples a token, where pooled")
    uv_pool: int = Field(5, ge=1, description="UV samples a token, where pooled")
    tv_stride: int = Field(
        1, ge=1, description="extension, not in the paper: TV samples averaged into one before the LSTM; 1 is full rate"
    )

    @model_validator(mode="after")
    def _heads_divide(self) -> Self:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} is no multiple of heads {self.heads}")
        return self


class AsiBip(nn.Module):
    """The network. tv_length, uv_length: samples of a window in each stream.

    Inputs are windows as cut, in m, m/s and m/s2; the standardisation is part of the network (see `set_scale`).
    """

    tv_mean: Tensor
    tv_sd: Tensor
    uv_mean: Tensor
    uv_sd: Tensor

    def __init__(self, settings: AsiBipSettings, n_classes: int, tv_length: int, uv_length: int) -> None:
        super().__init__()
        self.settings, self.n_classes = settings, n_classes
        for stream in ("tv", "uv"):
            self.register_buffer(f"{stream}_mean", torch.zeros(N_STATES, 1))
            self.register_buffer(f"{stream}_sd", torch.ones(N_STATES, 1))
        pools = (settings.tv_pool, settings.uv_pool) if settings.tokens == "pooled" else (1, 1)
        self.tv_branch = Branch(settings, -(-tv_length // settings.tv_stride), pools[0])
        self.uv_branch = Branch(settings, uv_length, pools[1])
        self.class_token = nn.Parameter(0.02 * torch.randn(1, 1, settings.width))
        layer = nn.TransformerEncoderLayer(
            settings.width, settings.heads, settings.feedforward, settings.dropout, "gelu",
            batch_first=True, norm_first=settings.norm_first,
        )  # fmt: skip
        layer.self_attn.dropout = settings.attention_dropout
        self.encoder = nn.TransformerEncoder(layer, settings.encoder_layers, enable_nested_tensor=False)
        self.norm = nn.LayerNorm(settings.width)
        self.head = nn.Sequential(nn.Dropout(settings.dropout), nn.Linear(settings.width, n_classes))

    def set_scale(self, tv_mean: Tensor, tv_sd: Tensor, uv_mean: Tensor, uv_sd: Tensor) -> None:
        """Channel means and standard deviations of training windows, each (6,); they are saved with the weights."""
        for name, value in (("tv_mean", tv_mean), ("tv_sd", tv_sd), ("uv_mean", uv_mean), ("uv_sd", uv_sd)):
            getattr(self, name).copy_(value[:, None])

    def features(self, tv: Tensor, uv: Tensor) -> Tensor:
        """The encoded classification token, (B, width). tv: (B, 6, T), uv: (B, 6, U)."""
        tv, uv = (tv - self.tv_mean) / self.tv_sd, (uv - self.uv_mean) / self.uv_sd
        if self.settings.tv_stride > 1:
            tv = nn.functional.avg_pool1d(tv, self.settings.tv_stride, ceil_mode=True)
        token = self.class_token.expand(len(tv), -1, -1)
        encoded = self.encoder(torch.cat([token, self.tv_branch(tv), self.uv_branch(uv)], dim=1))
        return torch.as_tensor(self.norm(encoded[:, 0]))

    def classify(self, features: Tensor) -> Tensor:
        """Logits, (B, n_classes), of the encoded classification token."""
        return torch.as_tensor(self.head(features))

    def forward(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Logits, (B, n_classes). tv: (B, 6, T), uv: (B, 6, U)."""
        return self.classify(self.features(tv, uv))


class Branch(nn.Module):
    """One stream: bidirectional LSTM, pooling, projection, learned position and stream embedding."""

    def __init__(self, settings: AsiBipSettings, length: int, pool: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(N_STATES, settings.hidden, settings.lstm_layers, bidirectional=True)
        self.pool = pool
        self.project = nn.Linear(2 * settings.hidden, settings.width)
        self.position = nn.Parameter(0.02 * torch.randn(1, -(-length // pool), settings.width))
        self.stream = nn.Parameter(0.02 * torch.randn(1, 1, settings.width))
        self.dropout = nn.Dropout(settings.dropout)

    def forward(self, x: Tensor) -> Tensor:
        """Tokens (B, ceil(T / pool), width) of a standardised stream (B, 6, T)."""
        out = self.lstm(x.permute(2, 0, 1))[0].permute(1, 2, 0)
        if self.pool > 1:
            out = nn.functional.avg_pool1d(out, self.pool, ceil_mode=True)
        tokens = self.project(out.transpose(1, 2)) + self.position + self.stream
        return torch.as_tensor(self.dropout(tokens))
