"""ASI-BIP: asynchronous spatio-temporal interaction behavioural intention prediction (Section III-C of the paper).

Two bidirectional LSTMs run over the streams, each at its own rate. A Transformer encoder attends over both outputs and
a learned classification token, which gives the intention.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from isac_cosim.base.settings import Settings
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.networks.lstms import has_bfloat16, outputs
from isac_cosim.models.networks.network import MOST_LAYERS, N_STATES, WindowNetwork, linear_head
from isac_cosim.models.networks.statistics_branch import RecentMotionBranch, StatisticsBranch
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import WindowShape

Streams = Literal["both", "tv", "uv"]
Rates = Literal["own", "slow", "fast"]
"""own: each stream at its rate. slow: the TV resampled to the UV's rate. fast: the UV interpolated to the TV's."""


class AsiBipSettings(Settings):
    """Sizes of the network, and every point that the paper leaves open."""

    hidden: int = Field(64, ge=1, le=65_536, description="units per LSTM direction")
    lstm_layers: int = Field(1, ge=1, le=MOST_LAYERS, description="layers of each LSTM")
    width: int = Field(128, ge=1, le=65_536, description="features per token, d")
    encoder_layers: int = Field(2, ge=1, le=MOST_LAYERS, description="layers of the Transformer encoder")
    heads: int = Field(8, ge=1, le=1024, description="attention heads")
    feedforward: int = Field(256, ge=1, le=65_536, description="hidden units of the feed-forward blocks in the encoder")
    norm_first: bool = Field(True, description="normalise before attention and feed-forward, not after")
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout of projection, attention, feed-forward and head")
    attention_dropout: float = Field(0.0, ge=0, lt=1, description="dropout of attention weights; 0 is faster")
    tokens: Literal["pooled", "literal"] = Field(
        "pooled",
        description="pooled: LSTM outputs averaged over tv_pool and uv_pool samples; literal: every output",
    )
    tv_pool: int = Field(20, ge=1, le=10_000, description="TV samples per pooled token")
    uv_pool: int = Field(5, ge=1, le=10_000, description="UV samples per pooled token")
    lstm_bfloat16: bool = Field(
        True,
        description="train the LSTMs in bfloat16, where the processor computes in it; predictions are always float32",
    )
    tv_patch: int = Field(
        1, ge=1, le=10_000, description="extension, not in the paper: TV samples side by side in one step of the LSTM"
    )
    uv_patch: int = Field(1, ge=1, le=10_000, description="extension, like tv_patch: UV samples in one step")
    statistics: bool = Field(
        False,
        description="extension, not in the paper: add a third branch to the class token, an MLP on the statistics that "
        "the boosted trees see",
    )

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} is not a multiple of heads {self.heads}")
        for pool, patch in ((self.tv_pool, self.tv_patch), (self.uv_pool, self.uv_patch)):
            if self.tokens == "pooled" and pool % patch:
                raise ValueError(f"a token of {pool} samples is not a whole number of patches of {patch}")
        return self


class AsiBip(WindowNetwork):
    """The network.

    tv_length, uv_length: samples per window of each stream. streams: "both" as in the paper; with one of them, the
    branch of the other is left out. rates: "own" as in the paper; otherwise a stream is resampled to the rate of the
    other one, and gets that one's patches and pools, so that there are as many tokens. recent_hz: an extension, not in
    the paper: the rate of the TV's stream, where a token of its recent motion is added.
    """

    def __init__(
        self,
        settings: AsiBipSettings,
        n_classes: int,
        tv_length: int,
        uv_length: int,
        streams: Streams = "both",
        rates: Rates = "own",
        recent_hz: float | None = None,
    ) -> None:
        super().__init__(n_classes)
        self.head = linear_head(settings.width, n_classes, settings.dropout)
        self.settings = settings
        own = {
            "tv": (tv_length, settings.tv_patch, settings.tv_pool),
            "uv": (uv_length, settings.uv_patch, settings.uv_pool),
        }
        at_rate_of = {name: {"own": name, "slow": "uv", "fast": "tv"}[rates] for name in own}
        self.lengths = tuple(own[at_rate_of[name]][0] for name in own)
        self.tv_branch, self.uv_branch = (
            Branch(settings, length, patch, pool // patch if settings.tokens == "pooled" else 1)
            if streams in ("both", name)
            else None
            for name, (length, patch, pool) in ((name, own[at_rate_of[name]]) for name in own)
        )
        self.statistics = (
            StatisticsBranch(2 if streams == "both" else 1, settings.feedforward, settings.width, settings.dropout)
            if settings.statistics
            else None
        )
        self.recent = None if recent_hz is None else RecentMotionBranch(tv_length, recent_hz, settings.width)
        self.class_token = _learned(1, settings.width)
        self.encoder = ClassTokenEncoder(settings)
        self.norm = nn.LayerNorm(settings.width)

    @property
    def lstm_precision(self) -> str:
        """In which precision the LSTMs are trained where the network is now."""
        return "bfloat16" if is_coarse(self.settings.lstm_bfloat16, self.class_token.device) else "float32"

    def fit_scale(self, tv: Tensor, uv: Tensor) -> None:
        """Set the scale of streams and statistics to that of training windows (n, 6, T) and (n, 6, U)."""
        super().fit_scale(tv, uv)
        if self.statistics is not None:
            self.statistics.fit_scale(*self._streams(*self.standardised(tv, uv)))
        if self.recent is not None:
            self.recent.fit_scale(self.standardised(tv, uv)[0])

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return the encoded classification token, (B, width), of standardised streams (B, 6, T) and (B, 6, U)."""
        class_token = self.class_token.expand(tv.shape[0], -1, -1)
        if self.statistics is not None:
            class_token = class_token + self.statistics(*self._streams(tv, uv))[:, None]
        more = [] if self.recent is None else [self.recent(tv)[:, None]]
        branches = [branch for branch in (self.tv_branch, self.uv_branch) if branch is not None]
        tv, uv = (resampled(x, length) for x, length in zip((tv, uv), self.lengths, strict=True))
        tokens = tokens_of(branches, self._streams(tv, uv))
        return torch.as_tensor(self.norm(self.encoder(torch.cat([class_token, *more, *tokens], dim=1))))

    def _streams(self, tv: Tensor, uv: Tensor) -> list[Tensor]:
        """Return the streams that the network looks at."""
        return [x for x, branch in ((tv, self.tv_branch), (uv, self.uv_branch)) if branch is not None]


class AsiBipPredictor(NetworkPredictor):
    """ASI-BIP as a predictor."""

    display_name = "ASI-BIP"
    summary = "two bidirectional LSTMs at their own rates, a Transformer encoder over both"
    settings_class: ClassVar[type[Settings] | None] = AsiBipSettings
    window_s = 10.3e-3
    streams: ClassVar[Streams] = "both"
    rates: ClassVar[Rates] = "own"
    recent: ClassVar[bool] = False

    @classmethod
    def build(cls, settings: FitSettings, shape: WindowShape) -> WindowNetwork:
        lengths = shape.tv_length, shape.uv_length
        recent_hz = shape.tv_rate_hz if cls.recent else None
        return AsiBip(settings.of(AsiBipSettings), shape.n_classes, *lengths, cls.streams, cls.rates, recent_hz)


class TvAlonePredictor(AsiBipPredictor):
    """A floor: ASI-BIP without the UV's stream."""

    display_name = "TV alone"
    summary = "asi-bip with the stream of the TV alone"
    window_s = 8.2e-3
    streams = "tv"


class UvAlonePredictor(AsiBipPredictor):
    """A floor: ASI-BIP without the TV's stream."""

    display_name = "UV alone"
    summary = "asi-bip with the stream of the UV alone"
    window_s = 2.5e-3
    streams = "uv"


class SlowPredictor(AsiBipPredictor):
    """A control of the asynchronous fusion: ASI-BIP with the TV's stream at the UV's rate."""

    display_name = "ASI-BIP, slow"
    summary = "asi-bip with the stream of the TV resampled to the rate of the UV: a control of the two rates"
    window_s = 5.2e-3
    rates = "slow"


class FastPredictor(AsiBipPredictor):
    """A control of the asynchronous fusion: ASI-BIP with the UV's stream at the TV's rate."""

    display_name = "ASI-BIP, fast"
    summary = "asi-bip with the stream of the UV interpolated to the rate of the TV: a control of the two rates"
    window_s = 17e-3
    rates = "fast"


class RecentPredictor(AsiBipPredictor):
    """An extension: ASI-BIP with a token of what the boosted trees see of the TV's recent motion."""

    display_name = "ASI-BIP, recent motion"
    summary = "asi-bip with a token of the TV's motion in the last 0.4 s, which the boosted trees see"
    recent = True


class ClassTokenEncoder(nn.Module):
    """A Transformer encoder of which only the first token is read.

    The last layer attends to all tokens, but computes its output for the first one alone.
    """

    def __init__(self, settings: AsiBipSettings) -> None:
        super().__init__()
        layers = [
            nn.TransformerEncoderLayer(
                settings.width, settings.heads, settings.feedforward, settings.dropout, "gelu",
                batch_first=True, norm_first=settings.norm_first,
            )
            for _ in range(settings.encoder_layers)
        ]  # fmt: skip
        for layer in layers:
            layer.self_attn.dropout = settings.attention_dropout
        self.layers = nn.ModuleList(layers)

    def forward(self, tokens: Tensor) -> Tensor:
        """Return the first token encoded, (B, width), of tokens (B, n, width)."""
        *whole, last = self.layers
        for layer in whole:
            tokens = layer(tokens)
        assert isinstance(last, nn.TransformerEncoderLayer)
        return first_of(last, tokens)


def first_of(layer: nn.TransformerEncoderLayer, tokens: Tensor) -> Tensor:
    """Return the first output of a layer, (B, width), of tokens (B, n, width); the others are not computed."""
    first = tokens[:, :1]
    context = layer.norm1(tokens) if layer.norm_first else tokens
    first = first + layer.dropout1(layer.self_attn(context[:, :1], context, context, need_weights=False)[0])
    if not layer.norm_first:
        first = layer.norm1(first)
    hidden = layer.dropout(layer.activation(layer.linear1(layer.norm2(first) if layer.norm_first else first)))
    first = first + layer.dropout2(layer.linear2(hidden))
    return torch.as_tensor(first if layer.norm_first else layer.norm2(first))[:, 0]


def _learned(steps: int, width: int) -> nn.Parameter:
    """Return what is added to each window, (1, steps, width), drawn from a normal distribution of sd 0.02."""
    values = torch.empty(1, steps, width)
    # Drawing for a tensor without memory makes PyTorch load its compiler, which takes a second.
    return nn.Parameter(values if values.is_meta else 0.02 * values.normal_())


class Branch(nn.Module):
    """One stream: patches, bidirectional LSTM, pooling, projection, learned position and stream embedding.

    length: samples per window. patch: samples in one step of the LSTM. pool: steps in one token.
    """

    def __init__(self, settings: AsiBipSettings, length: int, patch: int, pool: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(patch * N_STATES, settings.hidden, settings.lstm_layers, bidirectional=True)
        self.patch, self.pool = patch, pool
        self.coarse = settings.lstm_bfloat16
        self.project = nn.Linear(2 * settings.hidden, settings.width)
        self.position = _learned(-(-length // (patch * pool)), settings.width)
        self.stream = _learned(1, settings.width)
        self.dropout = nn.Dropout(settings.dropout)

    def steps(self, x: Tensor) -> Tensor:
        """Return the LSTM's input, (ceil(T / patch), B, 6 patch), of a standardised stream (B, 6, T)."""
        return patches(x, self.patch)

    def forward(self, out: Tensor) -> Tensor:
        """Return tokens (B, ceil(T / (patch pool)), width) of LSTM outputs (ceil(T / patch), B, 2 hidden)."""
        # Time stays the first axis up to the tokens, because transposing all LSTM outputs costs as much as attention.
        tokens = self.project(pooled(out, self.pool)).transpose(0, 1) + self.position + self.stream
        return torch.as_tensor(self.dropout(tokens))


def tokens_of(branches: Sequence[Branch], streams: Sequence[Tensor]) -> list[Tensor]:
    """Return the tokens of each branch, (B, tokens, width), of its standardised stream (B, 6, T)."""
    steps = [branch.steps(x) for branch, x in zip(branches, streams, strict=True)]
    coarse = branches[0].training and is_coarse(branches[0].coarse, streams[0].device)
    with torch.autocast("cpu", torch.bfloat16, enabled=coarse):
        outs = outputs([branch.lstm for branch in branches], steps)
    return [branch(out.to(x.dtype)) for branch, out, x in zip(branches, outs, streams, strict=True)]


def is_coarse(wanted: bool, device: torch.device) -> bool:
    """Return whether LSTMs are trained in bfloat16: elsewhere, PyTorch emulates it or refuses."""
    return wanted and device.type == "cpu" and has_bfloat16()


def resampled(x: Tensor, length: int) -> Tensor:
    """Return a stream (B, 6, T) interpolated linearly to `length` samples, the first and last of which stay."""
    if x.shape[2] == length:
        return x
    return nn.functional.interpolate(x, length, mode="linear", align_corners=True)


def patches(x: Tensor, size: int) -> Tensor:
    """Return steps of `size` samples side by side, (ceil(T / size), B, 6 size), of a stream (B, 6, T).

    The last patch ends with the window; the first one is padded with the window's first sample.
    """
    if size > 1:
        x = nn.functional.pad(x, (-x.shape[2] % size, 0), mode="replicate")
        x = x.reshape(*x.shape[:2], -1, size).transpose(2, 3).flatten(1, 2)
    return x.permute(2, 0, 1)


def pooled(x: Tensor, size: int) -> Tensor:
    """Return means over `size` steps of the first axis, (ceil(T / size), ...); the last may be over fewer."""
    if size == 1:
        return x
    whole = len(x) // size
    means = x[: whole * size].reshape(whole, size, *x.shape[1:]).mean(dim=1)
    if whole * size == len(x):
        return means
    return torch.cat((means, x[whole * size :].mean(dim=0, keepdim=True)))
