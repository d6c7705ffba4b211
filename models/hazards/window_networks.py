"""The networks that answer windows, trained on streams: with one sigmoid an intention and interval.

The lanes enter beside the network: what they say of the window (`models.data.situation`) goes through a small layer of
its own, whose log-odds are added to the network's. Without the lanes, or without the UV, the same network is trained
without them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
import torch
from torch import Tensor, nn

from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.hazards.predictor import HazardFacts, Hazards, NetworkOnStreams, StreamTask, hazards_of, n_logits
from isac_cosim.models.hazards.sight import N_SITUATION, situation_of
from isac_cosim.models.networks.network import WindowNetwork, seed_weights
from isac_cosim.models.predictors.asi_bip import AsiBipPredictor
from isac_cosim.models.predictors.castformer import CastformerPredictor
from isac_cosim.models.predictors.inception_time import InceptionTimePredictor
from isac_cosim.models.predictors.network_predictor import NetworkPredictor
from isac_cosim.models.predictors.protocol import FitSummary, WindowShape

if TYPE_CHECKING:
    from isac_cosim.models.hazards.stored_windows import Inputs

BESIDE = 32
"""Width of the layer beside the network."""
SCALED_BY = 4000
"""At most so many windows give the scale of the inputs."""


class HazardNetwork(nn.Module):
    """A network over windows, and a layer beside it over the situation.

    body: its logits are those of the hazards. lanes: numbers that say of the situation; 0 for none.
    """

    mean: Tensor
    sd: Tensor

    def __init__(self, body: WindowNetwork, lanes: int) -> None:
        super().__init__()
        self.body = body
        self.register_buffer("mean", torch.zeros(lanes))
        self.register_buffer("sd", torch.ones(lanes))
        self.beside = (
            nn.Sequential(nn.Linear(lanes, BESIDE), nn.GELU(), nn.Linear(BESIDE, body.n_classes)) if lanes else None
        )

    @property
    def parameter_count(self) -> int:
        """How many numbers are trained."""
        return sum(parameter.numel() for parameter in self.parameters())

    def fit_scale(self, tv: Tensor, uv: Tensor, situation: Tensor) -> None:
        """Set the scale of the inputs by training windows (n, 6, T), (n, 6, U) and what is beside them, (n, F)."""
        self.body.fit_scale(tv, uv)
        if self.beside is None:
            return
        self.mean.copy_(situation.double().mean(dim=0))
        self.sd.copy_(situation.double().std(dim=0, correction=0) + 1e-3)

    def forward(self, tv: Tensor, uv: Tensor, situation: Tensor) -> Tensor:
        """Return logits (B, 5 H + 1)."""
        logits = self.body.training_logits(tv, uv)["joint"]
        if self.beside is not None:
            logits = logits + self.beside(((situation - self.mean) / self.sd).clamp(-8.0, 8.0))
        return torch.as_tensor(logits)


class WindowNetworkOnStreams(NetworkOnStreams):
    """A network that answers windows. kind: the predictor on records with the same network."""

    kind: ClassVar[type[NetworkPredictor]]
    network: HazardNetwork

    @classmethod
    def built(cls, facts: HazardFacts, settings: FitSettings, shape: WindowShape) -> HazardNetwork:
        body = cls.kind.build(settings, replace(shape, n_classes=n_logits(facts)))
        return HazardNetwork(body, N_SITUATION if facts.lanes else 0)

    @classmethod
    def fit_streams(cls, task: StreamTask, feedback: Feedback) -> Self:
        # What training alone needs takes seconds to import.
        from isac_cosim.base.temporary import TemporaryFolder
        from isac_cosim.models.hazards.hazard_training import fit_hazards
        from isac_cosim.models.hazards.stored_windows import StoredWindows

        facts = task.facts()
        seed_weights(task.fit.seed)
        network = cls.built(facts, task.fit, task.shape)
        untrained = cls(facts, task.shape, network)

        def inputs(windows: Windows) -> Inputs:
            return untrained.inputs(untrained.seen(windows))

        with TemporaryFolder() as folder:
            training, validation = (
                StoredWindows.written(folder.path / name, side, inputs, feedback)
                for name, side in (("train", task.training), ("validation", task.validation))
            )
            network.fit_scale(*training.some(SCALED_BY))
            fitted = fit_hazards(network, training, validation, task, facts, feedback)
        summary = FitSummary(fitted.best_epoch, network.parameter_count)
        return cls(facts, task.shape, network.eval(), summary).calibrated(task.validation)

    def hazards(self, windows: Windows) -> Hazards:
        with torch.inference_mode():
            logits = self.network(*map(torch.from_numpy, self.inputs(windows)))
        return hazards_of(logits.double().numpy(), self.facts)

    def inputs(self, windows: Windows) -> Inputs:
        """Return what goes into the network: tv (n, 6, T), uv (n, 6, U), situation (n, F). windows: as seen."""
        beside = situation_of(windows) if self.facts.lanes else np.empty((len(windows), 0))
        return windows.tv, windows.uv, beside.astype(np.float32)


class AsiBipOnStreams(WindowNetworkOnStreams):
    """ASI-BIP."""

    kind, display_name, summary = AsiBipPredictor, "ASI-BIP on streams", "ASI-BIP, with the situation beside it"
    optimiser_defaults: ClassVar[dict[str, object]] = {"epochs": 8, "learning_rate": 1e-3, "schedule": "cosine"}


class InceptionTimeOnStreams(WindowNetworkOnStreams):
    """InceptionTime."""

    kind, display_name = InceptionTimePredictor, "InceptionTime on streams"
    summary = "InceptionTime, with the situation beside it"


class CastformerOnStreams(WindowNetworkOnStreams):
    """CaSTFormer."""

    kind, display_name, summary = (
        CastformerPredictor,
        "CaSTFormer on streams",
        "CaSTFormer, with the situation beside it",
    )
    optimiser_defaults = CastformerPredictor.optimiser_defaults
