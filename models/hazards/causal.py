"""The causal network: it runs along a stream, one step a decision, and remembers what it needs of the steps before."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
import torch

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap, Windows
from isac_cosim.models.hazards.blocks import FEATURES, steps_of
from isac_cosim.models.hazards.predictor import HazardFacts, Hazards, NetworkOnStreams, StreamTask, hazards_of, n_logits
from isac_cosim.models.hazards.settings import StreamFitSettings
from isac_cosim.models.hazards.sight import samples_of, uv_for
from isac_cosim.models.networks.causal import CausalNetwork, CausalState, layers_within
from isac_cosim.models.networks.network import seed_weights
from isac_cosim.models.predictors.protocol import FitSummary, Outputs, WindowShape


class CausalPredictor(NetworkOnStreams):
    """A causal convolution over steps of the length of the time between decisions; a window shows the latest steps."""

    display_name = "causal network"
    summary = "a causal convolution that runs along the stream, one step a decision"
    network: CausalNetwork
    optimiser_defaults: ClassVar[dict[str, object]] = {
        "epochs": 25,
        "learning_rate": 2e-3,
        "schedule": "cosine",
        "patience": 6,
        "weight_decay": 0.01,
    }

    def __init__(
        self, facts: HazardFacts, shape: WindowShape, network: CausalNetwork, fit_summary: FitSummary | None = None
    ) -> None:
        super().__init__(facts, shape, network, fit_summary)
        self.samples = samples_of(shape, facts.decision_s)

    @classmethod
    def built(cls, facts: HazardFacts, settings: FitSettings, shape: WindowShape) -> CausalNetwork:
        """Return an untrained network that depends on no more steps than a window holds."""
        streams: StreamFitSettings = settings.streams  # type: ignore[attr-defined]
        layers = layers_within(shape.tv_length // samples_of(shape, facts.decision_s)[0])
        return CausalNetwork(len(FEATURES), streams.causal.width, layers, n_logits(facts), streams.causal.dropout)

    @classmethod
    def fit_streams(cls, task: StreamTask, feedback: Feedback) -> Self:
        # Lightning takes seconds to import, and only training needs it.
        from isac_cosim.models.hazards.hazard_training import fit_hazards
        from isac_cosim.models.hazards.sequences import Sequences

        facts, length = task.facts(), task.settings.causal.sequence
        training, validation = (
            Sequences.of(side, length, feedback, f"reading streams to {purpose}")
            for side, purpose in ((task.training, "train on"), (task.validation, "choose on"))
        )
        seed_weights(task.fit.seed)
        network = cls.built(facts, task.fit, task.shape)
        network.fit_scale(torch.from_numpy(training.steps.reshape(-1, training.steps.shape[2])))
        fitted = fit_hazards(network, training.items(), validation.items(), task, facts, feedback)
        summary = FitSummary(fitted.best_epoch, network.parameter_count)
        return cls(facts, task.shape, network.eval(), summary).calibrated(task.validation)

    def hazards(self, windows: Windows) -> Hazards:
        with torch.inference_mode():
            logits = self.network(torch.from_numpy(self._steps(windows)))[:, -1]
        return hazards_of(logits.double().numpy(), self.facts)

    def along(self, on_map: OnMap, decisions: int) -> Outputs:
        """Return the answers to the last decisions of a stream, one a step; each is that to the window that ends there.

        on_map: of a single TV and its UV, (1, 6, T) and (1, 6, U), from the beginning of the first window on.
        """
        if not self.facts.uv:
            on_map = replace(on_map, uv=uv_for(on_map.tv, on_map.uv.shape[2], self.shape))
        with torch.inference_mode():
            logits = self.network(torch.from_numpy(steps_of(on_map, self.samples, self.facts.lanes)))
        return self.answered(hazards_of(logits[0, -decisions:].double().numpy(), self.facts))

    def begin(self, windows: Windows) -> tuple[Outputs, CausalState]:
        """Return the answers to windows, and what is to be remembered to go on with one step a decision."""
        state = self.network.begin(len(windows))
        with torch.inference_mode():
            for step in torch.from_numpy(self._steps(self.seen(windows))).unbind(dim=1):
                logits, state = self.network.step(step, state)
        return self.answered(hazards_of(logits.double().numpy(), self.facts)), state

    def step(self, latest: Windows, state: CausalState) -> tuple[Outputs, CausalState]:
        """Return the answers at the next decision, and the state after it.

        latest: at least the samples since the decision before, of both streams; what is older is not looked at. A TV
        whose UV is another one than before begins anew.
        """
        with torch.inference_mode():
            step = torch.from_numpy(self._steps(self.seen(latest))[:, -1])
            logits, state = self.network.step(step, state)
        return self.answered(hazards_of(logits.double().numpy(), self.facts)), state

    def _steps(self, windows: Windows) -> Float32Array:
        on_map = windows.on_map
        if on_map is None:
            # Without lanes, it does not matter where on the road a window lies.
            nowhere = np.full(len(windows), "", dtype=object)
            tv, uv = windows.tv.astype(np.float64), windows.uv.astype(np.float64)
            on_map = OnMap(tv, uv, self.shape.tv_rate_hz, nowhere, _unknown)
        return steps_of(on_map, self.samples, self.facts.lanes)


def _unknown(scenario: str) -> LaneMap:
    raise AssertionError("the lanes are not looked at")
