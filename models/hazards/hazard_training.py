"""What Lightning runs to train networks on streams: decisions, shuffled anew in each epoch, and the hazards' loss."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.utils.data import DataLoader, Dataset

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.seeding import stream
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.predictor import HazardFacts, StreamTask
from isac_cosim.models.networks.fitting import BestEpoch, fit_module
from isac_cosim.models.networks.lightning_module import Monitor, ResumedData, TrainedModule
from isac_cosim.models.networks.network import torch_seed

VALIDATED = 64
"""Validation sequences in a batch."""
MONITOR = Monitor("validation_loss", "min", "loss")
Batch = list[Tensor]
"""What a network sees of B items, then interval (B, ..., 5), passing and weight (B, ...) of their decisions."""


def fit_hazards(
    network: nn.Module,
    training: Dataset[Any],
    validation: Dataset[Any],
    task: StreamTask,
    facts: HazardFacts,
    feedback: Feedback,
) -> BestEpoch:
    """Train a network, or resume where its training stopped, and give it the weights of the best epoch.

    training, validation: items are what the network sees, then interval (..., 5), passing and weight (...). A network
    that answers a sequence answers the last of it.
    """
    data = _Data(training, validation, task.fit)
    return fit_module(_Module(network, task.fit, facts), data, MONITOR, task.folder, feedback)


def hazard_loss(
    logits: Tensor, interval: Tensor, passing: Tensor, weight: Tensor, learned: Tensor, horizons: int
) -> Tensor:
    """Return the weighted mean over decisions of the cross-entropy of all hazards that are asked, a scalar.

    logits: (..., 5 H + 1). interval: (..., 5). passing, weight: (...). learned: which of WITH_HAZARD are, (5,).
    A hazard is asked until the intention has begun.
    """
    of_intervals = logits[..., :-1].reshape(*logits.shape[:-1], len(WITH_HAZARD), horizons)
    number = torch.arange(horizons, device=logits.device)
    answer = interval[..., None]
    asked = (answer >= number) & (answer != IGNORED) & learned[:, None]
    begins = functional.binary_cross_entropy_with_logits(of_intervals, (answer == number).float(), reduction="none")
    judged = passing != IGNORED
    passes = functional.binary_cross_entropy_with_logits(logits[..., -1], (passing == 1).float(), reduction="none")
    of_decision = (begins * asked).sum(dim=(-2, -1)) + passes * judged
    decisions = ((interval != IGNORED).any(dim=-1) * weight).sum().clamp(min=1)
    return (of_decision * weight).sum() / decisions


class _Module(TrainedModule):
    def __init__(self, network: nn.Module, settings: FitSettings, facts: HazardFacts) -> None:
        super().__init__()
        self.network, self.settings = network, settings
        self.horizons = len(facts.horizons_s)
        self.register_buffer("learned", torch.from_numpy(facts.is_learned), persistent=False)

    def training_step(self, batch: Batch, k: int) -> Tensor:
        """Return the loss of the k-th batch of an epoch."""
        torch.manual_seed(torch_seed("dropout", self.settings.seed, self.current_epoch, k))
        loss = self._loss(batch)
        self.refuse_nonfinite(loss, f"batch {k + 1}")
        self.log("train_loss", loss, on_step=False, on_epoch=True, batch_size=len(batch[0]))
        return loss

    def validation_step(self, batch: Batch, k: int) -> None:
        """Log the loss of a batch of validation sequences."""
        self.log(MONITOR.name, self._loss(batch), batch_size=len(batch[0]))

    def _loss(self, batch: Batch) -> Tensor:
        *inputs, interval, passing, weight = batch
        logits = self.network(*inputs)
        if interval.ndim == 3:
            logits = logits[:, logits.shape[1] - interval.shape[1] :]
        return hazard_loss(logits, interval, passing, weight, self.get_buffer("learned"), self.horizons)


class _Data(ResumedData):
    def __init__(self, training: Dataset[Any], validation: Dataset[Any], settings: FitSettings) -> None:
        super().__init__()
        self.training, self.validation, self.settings = training, validation, settings

    def train_dataloader(self) -> DataLoader[Any]:
        """Return the training sequences; each epoch has an order of its own, also where it is resumed."""
        return DataLoader(self.training, self.settings.optimiser.batch, sampler=_Shuffled(self))

    def val_dataloader(self) -> DataLoader[Any]:
        """Return the validation sequences."""
        return DataLoader(self.validation, VALIDATED)


class _Shuffled(torch.utils.data.Sampler[int]):
    def __init__(self, data: _Data) -> None:
        self.data = data

    def __len__(self) -> int:
        items: Any = self.data.training
        return len(items)

    def __iter__(self):  # type: ignore[no-untyped-def]
        order = stream("shuffle sequences", self.data.settings.seed, self.data.epoch).permutation(len(self))
        return iter(order.tolist())
