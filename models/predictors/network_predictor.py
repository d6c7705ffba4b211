"""The base class of predictors that are a single neural network."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import ClassVar, Self

import torch

from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.networks.checkpoints import read_weights, write_weights
from isac_cosim.models.networks.network import WindowNetwork, seed_weights
from isac_cosim.models.predictors.protocol import (
    STATISTICS_S,
    FitSummary,
    FitTask,
    Outputs,
    Predictor,
    WindowShape,
    Workload,
)

WEIGHTS_FILE = "weights.pt"
ANSWER_SHARE = 0.25
"""Processor time of an answer, relative to a training step on the same window."""


def answering_device(accelerator: str) -> torch.device:
    """Return where networks answer: a CUDA GPU if there is one and the accelerator is not "cpu"; otherwise the CPU."""
    return torch.device("cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu")


class NetworkPredictor(Predictor):
    """A network that answers in float32, trained by the loop of `models.networks.fitting`.

    Beside what `Predictor` asks for, a subclass declares window_s, the processor time of a training step per window, s,
    and implements `build`.
    """

    is_network = True
    window_s: ClassVar[float]

    def __init__(self, network: WindowNetwork, fit_summary: FitSummary | None = None) -> None:
        self.network = network
        self.fit_summary = fit_summary or FitSummary()

    @classmethod
    @abstractmethod
    def build(cls, settings: FitSettings, shape: WindowShape) -> WindowNetwork:
        """Return the untrained network for windows of a shape; `settings.of(...)` gives the predictor's own section."""

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        # Lightning takes seconds to import, and only training needs it.
        from isac_cosim.models.networks.fitting import fit_network

        seed_weights(task.settings.seed)
        network = cls.build(task.settings, task.shape)
        fitted = fit_network(network, task.training, task.validation, task.settings, task.folder, feedback, task.logs)
        network.eval().to(answering_device(task.settings.optimiser.accelerator))
        summary = FitSummary(fitted.best_epoch, network.parameter_count, fitted.score, network.lstm_precision)
        return cls(network, summary)

    def save(self, folder: Path) -> None:
        write_weights(folder / WEIGHTS_FILE, self.network)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        network = read_weights(folder / WEIGHTS_FILE, lambda: cls.build(settings, shape))
        return cls(network.eval().to(answering_device(settings.optimiser.accelerator)))

    def __call__(self, windows: Windows) -> Outputs:
        device = next(self.network.parameters()).device
        with torch.inference_mode():
            tv, uv = (torch.from_numpy(stream).to(device) for stream in (windows.tv, windows.uv))
            features = self.network.features(tv, uv)
            logits = self.network.classify(features)
        return Outputs(logits.double().cpu().numpy(), features.double().cpu().numpy())

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        epochs = settings.optimiser.epochs
        trained = workload.training * settings.ends_per_record * epochs
        answered = workload.validation * settings.validation_ends * epochs + workload.tested
        steps_s = cls.window_s * workload.scale * (trained + ANSWER_SHARE * answered)
        return steps_s + STATISTICS_S * workload.scale * workload.tested
