"""CaSTFormer: causal spatio-temporal Transformer for driving intention, from its paper.

Each of two streams of frames is projected, given a position code and encoded by a causal Transformer. The modules RSF,
CPE and FSN (`models.networks.castformer_modules`) follow, in the order of the settings; each can be turned off. For
windows, a frame holds the samples of `frame_s`; the TV is the paper's `in` stream and the UV its `out` stream.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.networks.castformer_inspection import Inspection, inspected
from isac_cosim.models.networks.castformer_modules import (
    Attention,
    CausalPatternExtraction,
    CausalResidual,
    Confidence,
    FeatureSynthesis,
    MeanOver,
    ReciprocalShiftFusion,
    Source,
    State,
    joint,
)
from isac_cosim.models.networks.losses import focal_loss
from isac_cosim.models.networks.network import LONGEST, MOST_LAYERS, N_STATES, WindowNetwork, linear_head
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import WindowShape

Order = Literal["rsf-cpe-fsn", "cpe-rsf-fsn", "rsf-fsn-cpe", "cpe-fsn-rsf"]
SPEED_UNIT_M_S = 10.0
"""Unit of the speed input, m/s, in which speeds are of order 1."""
PAPER_OPTIMISER = {"epochs": 160, "batch": 16, "learning_rate": 1e-3}
"""The optimiser of the paper, by the names of `OptimiserSettings`."""


class CastformerSettings(Settings):
    """Sizes of the network, its three modules, and every point that the paper leaves open."""

    frame_s: float = Field(0.1, gt=0, le=1e3, description="length of a frame, s")
    width: int = Field(64, ge=1, le=65_536, description="features per frame, D")
    heads: int = Field(8, ge=1, le=1024, description="attention heads")
    encoder_layers: int = Field(2, ge=1, le=MOST_LAYERS, description="layers of the Transformer encoder of each stream")
    feedforward: int = Field(
        128, ge=1, le=65_536, description="hidden units of the feed-forward blocks in encoders and FSN"
    )
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout in encoders, attention and RSF, and before the logits")
    causal_encoder: bool = Field(True, description="encoders do not let a frame see a later one")
    rsf: bool = Field(True, description="reciprocal shift fusion")
    cpe: bool = Field(True, description="causal pattern extraction")
    fsn: bool = Field(True, description="feature synthesis; without it the streams are concatenated")
    order: Order = Field("rsf-cpe-fsn", description="order of the modules that are on")
    attention: Attention = Field(
        "bda",
        description="the past that RSF attends to. bda: each stream to that of the other; self: to its own; joint: to "
        "both; one_way: `in` to that of `out`, `out` to its own",
    )
    delay_frames: int = Field(1, ge=0, le=LONGEST, description="delay of the keys; with 0 a frame sees its own instant")
    residual: bool = Field(False, description="RSF adds to a stream instead of replacing it")
    detach_mean: bool = Field(True, description="no gradient through the mean in the counterfactual")
    mean_over: MeanOver = Field(
        "window",
        description="what the mean in the counterfactual is over. window: the frames that a query sees; batch: all "
        "frames of a training batch, as in the paper; predictions use the running average of these",
    )
    intent_source: Source = Field("in", description="stream that gives the coarse intention; in the paper: out")
    alpha: float = Field(0.1, ge=0, le=1e6, description="weight of the loss of the coarse intention")

    @model_validator(mode="after")
    def _heads_divide(self) -> Self:
        if self.width % self.heads:
            raise ValueError(f"width {self.width} is not a multiple of heads {self.heads}")
        return self

    @property
    def modules(self) -> list[str]:
        """The modules that are on, in order."""
        return [name for name in self.order.split("-") if getattr(self, name)]


class StreamEncoder(nn.Module):
    """Linear projection of frames, sinusoidal position, Transformer encoder."""

    def __init__(self, in_width: int, settings: CastformerSettings) -> None:
        super().__init__()
        self.causal = settings.causal_encoder
        self.project = nn.Linear(in_width, settings.width)
        layer = nn.TransformerEncoderLayer(
            settings.width, settings.heads, settings.feedforward, settings.dropout, batch_first=True, norm_first=True
        )
        self.encoder = nn.TransformerEncoder(
            layer, settings.encoder_layers, nn.LayerNorm(settings.width), enable_nested_tensor=False
        )
        self.dropout = nn.Dropout(settings.dropout)

    def forward(self, frames: Tensor) -> Tensor:
        """Return (B, T, D) of frames (B, T, in_width)."""
        x = self.project(frames)
        x = self.dropout(x + positions(x.shape[1], x.shape[2]).to(x))
        mask = None
        if self.causal:
            mask = torch.ones(x.shape[1], x.shape[1], dtype=torch.bool, device=x.device).triu(1)
        return torch.as_tensor(self.encoder(x, mask=mask, is_causal=self.causal))


def positions(length: int, width: int) -> Tensor:
    """Return the sinusoidal position code, (T, D). Source: Vaswani et al. 2017, Section 3.5."""
    at = torch.arange(length)[:, None]
    rate = torch.exp(-math.log(10_000.0) * (torch.arange(width) // 2 * 2) / width)
    return torch.where(torch.arange(width) % 2 == 0, torch.sin(at * rate), torch.cos(at * rate))


class CastformerCore(nn.Module):
    """The network on frames of any width: `in` (B, T, in_width), `out` (B, T, out_width), speed (B, T, 1) or None.

    The original features of Brain4Cars are 65 and 33 wide, the speed being the last of each.
    """

    def __init__(
        self, settings: CastformerSettings, n_classes: int, in_width: int, out_width: int, speed: bool
    ) -> None:
        super().__init__()
        width, names = settings.width, settings.modules
        self.settings = settings
        self.inner = StreamEncoder(in_width, settings)
        self.outer = StreamEncoder(out_width, settings)
        self.stages = nn.ModuleList(
            _stage(name, settings, n_classes, token="cpe" in names[:k], speed=speed) for k, name in enumerate(names)
        )
        self.last_reader = max((k for k, name in enumerate(names) if name != "fsn"), default=0)
        """Number of the last module in which a frame reads others."""
        self.features_width = width * (3 if settings.fsn or settings.cpe else 2)
        self.head: nn.Module = (
            Confidence(width, n_classes, settings.dropout)
            if settings.fsn
            else linear_head(self.features_width, n_classes, settings.dropout)
        )

    def states(self, inner: Tensor, outer: Tensor, speed: Tensor | None = None, last: bool = False) -> State:
        """Return the state after the last module, at every frame; last: at the last frame only, (B, 1, ...)."""
        state = State(self.inner(inner), self.outer(outer), speed)
        for k, stage in enumerate(self.stages):
            past = state
            if last and k >= self.last_reader:
                state = state.last()
            state = stage(state, past)
        return state

    def features(self, state: State) -> Tensor:
        """Return the features of the last frame, (B, features_width): the three branches, or the concatenated streams.

        Without FSN, the intention token follows the streams, if there is one.
        """
        third = state.context if state.context is not None else state.token
        parts = (state.inner, state.outer) if third is None else (state.inner, state.outer, third)
        return torch.cat([x[:, -1] for x in parts], dim=1)

    def training_logits(self, inner: Tensor, outer: Tensor, speed: Tensor | None = None) -> dict[str, Tensor]:
        """Return logits (B, M) by name: `joint`; with FSN `in`, `out` and `context`; with CPE `intent`."""
        state = self.states(inner, outer, speed, last=True)
        features = self.features(state)
        if isinstance(self.head, Confidence):
            logits, weight = self.head.branches(features)
            by_name = {"joint": joint(logits, weight)}
            by_name |= dict(zip(("in", "out", "context"), logits.unbind(dim=1), strict=True))
        else:
            by_name = {"joint": self.head(features)}
        if state.intent is not None:
            by_name["intent"] = state.intent[:, -1]
        return by_name

    def forward(self, inner: Tensor, outer: Tensor, speed: Tensor | None = None) -> Tensor:
        """Return the joint logits, (B, M)."""
        return torch.as_tensor(self.head(self.features(self.states(inner, outer, speed, last=True))))


def _stage(name: str, settings: CastformerSettings, n_classes: int, token: bool, speed: bool) -> nn.Module:
    """Return one of the three modules. token: whether a module before it extracts an intention token."""
    attention = settings.width, settings.heads, settings.dropout, settings.delay_frames
    if name == "rsf":
        return ReciprocalShiftFusion(*attention, settings.attention, settings.residual)
    if name == "cpe":
        inner, outer = (CausalResidual(*attention, settings.detach_mean, settings.mean_over) for _ in range(2))
        return CausalPatternExtraction(inner, outer, settings.width, n_classes, settings.intent_source)
    return FeatureSynthesis(settings.width, settings.feedforward, token, speed)


def castformer_loss(logits: dict[str, Tensor], label: Tensor, weight: Tensor | None, alpha: float) -> Tensor:
    """Return the mean cross-entropy of all branches and the joint logits, plus alpha times that of the intention.

    logits: by name, as `CastformerCore.training_logits` returns them. label: (B,). weight: of the classes, (M,), all 1
    if None. Source: Eq. (12).
    """
    main = [focal_loss(values, label, weight, 0.0) for name, values in logits.items() if name != "intent"]
    loss = torch.stack(main).mean()
    if "intent" in logits:
        loss = loss + alpha * focal_loss(logits["intent"], label, weight, 0.0)
    return loss


class Castformer(WindowNetwork):
    """CaSTFormer on windows.

    If a window is not a whole number of frames, its earliest samples are left out. The speed is that of the TV in the
    window's frame of reference. Raises InputError if a window is shorter than two frames.
    """

    def __init__(self, settings: CastformerSettings, shape: WindowShape) -> None:
        frame = [max(1, round(settings.frame_s * rate)) for rate in (shape.tv_rate_hz, shape.uv_rate_hz)]
        count = min(shape.tv_length // frame[0], shape.uv_length // frame[1])
        if count < 2:
            raise InputError(f"castformer.frame_s {settings.frame_s:g}: a window has fewer than two frames; shorten it")
        super().__init__(shape.n_classes)
        self.settings, self.frame, self.count = settings, frame, count
        self.core = CastformerCore(settings, shape.n_classes, N_STATES * frame[0], N_STATES * frame[1], speed=True)

    def encode(self, tv: Tensor, uv: Tensor) -> Tensor:
        """Return features (B, features_width) of standardised streams (B, 6, T) and (B, 6, U)."""
        return self.core.features(self.core.states(*self.frames(tv, uv), last=True))

    def classify(self, features: Tensor) -> Tensor:
        """Return the joint logits (B, n_classes) of features."""
        return torch.as_tensor(self.core.head(features))

    def frames(self, tv: Tensor, uv: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return frames (B, count, 6 n) of both standardised streams, and the TV's speed at each end, (B, count, 1)."""
        inner, outer = (in_frames(x, n, self.count) for x, n in ((tv, self.frame[0]), (uv, self.frame[1])))
        velocity = tv[:, 2:4] * self.tv_sd[2:4] + self.tv_mean[2:4]
        ends = velocity[:, :, self.frame[0] - 1 + tv.shape[2] - self.count * self.frame[0] :: self.frame[0]]
        return inner, outer, ends.square().sum(dim=1).add(1e-6).sqrt()[:, :, None] / SPEED_UNIT_M_S

    def training_logits(self, tv: Tensor, uv: Tensor) -> dict[str, Tensor]:
        """Return logits (B, n_classes) by name, as `CastformerCore.training_logits` does."""
        return self.core.training_logits(*self.frames(*self.standardised(tv, uv)))

    def loss(self, logits: dict[str, Tensor], label: Tensor, weight: Tensor | None, gamma: float) -> Tensor:
        """Return the loss of Eq. (12); gamma, of the focal loss, is not used."""
        return castformer_loss({k: v.float() for k, v in logits.items()}, label, weight, self.settings.alpha)


class CastformerPredictor(NetworkPredictor):
    """CaSTFormer as a predictor, trained with the paper's optimiser unless other values are given."""

    display_name = "CaSTFormer"
    summary = "causal spatio-temporal Transformer on frames of 0.1 s"
    settings_class: ClassVar[type[Settings] | None] = CastformerSettings
    optimiser_defaults: ClassVar[Mapping[str, object]] = PAPER_OPTIMISER
    window_s = 2.4e-3

    network: Castformer

    @classmethod
    def build(cls, settings: FitSettings, shape: WindowShape) -> WindowNetwork:
        return Castformer(settings.of(CastformerSettings), shape)

    def inspect(self, windows: Windows) -> Inspection:
        """Return what the modules do with windows, at their last frame."""
        device = next(self.network.parameters()).device
        tv, uv = (torch.from_numpy(stream).to(device) for stream in (windows.tv, windows.uv))
        return inspected(self.network.core, lambda: self.network.classify(self.network.features(tv, uv)))


def in_frames(x: Tensor, size: int, count: int) -> Tensor:
    """Return the last `count` frames of `size` samples of a stream (B, 6, T), (B, count, 6 size)."""
    x = x[:, :, x.shape[2] - count * size :]
    return x.reshape(x.shape[0], x.shape[1], count, size).transpose(1, 2).flatten(2)
