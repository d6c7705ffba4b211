"""What Lightning runs: the windows of every epoch, the loss and its optimiser, the history."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset
from torchmetrics.classification import MulticlassF1Score

from isacsim.arrays import IntArray
from isacsim.files import replace_file
from isacsim.seeding import stream
from models.data.augment import augmented
from models.data.windows import Ends, Records, Windows, batches, cut, draw_ends
from models.predictors.losses import exposure_loss
from models.predictors.network import WindowNetwork
from models.predictors.reject_option import prelude_windows
from models.run import TrainSettings

MONITOR = "validation_macro_f1"
SCALE_WINDOWS = 2000
OUTLIER = -1
"""The label of a window that is no intention."""
Batch = tuple[Tensor, Tensor, Tensor]
Vary = Callable[[int, Windows, IntArray], tuple[Windows, IntArray]]
"""The k-th batch of an epoch and its labels to what is shown instead."""
Labelled = tuple[Ends, IntArray]


def torch_seed(*keys: str | int) -> int:
    """A seed for torch's own generator, named by its purpose like a stream."""
    return int(stream("torch", *keys).integers(2**62))


class WindowData(lightning.LightningDataModule):
    """Training windows drawn anew each epoch, and fixed validation windows."""

    def __init__(self, training: Records, validation: Records, settings: TrainSettings) -> None:
        super().__init__()
        self.training, self.validation, self.settings = training, validation, settings
        self.next_epoch = 0
        self.fixed = draw_ends(
            validation, settings.windows, "validation", settings.seed, per_record=settings.validation_ends
        )

    def first_windows(self) -> tuple[Tensor, Tensor]:
        """Windows of the first epoch, at most SCALE_WINDOWS, to standardise by: (n, 6, T) and (n, 6, U)."""
        windows = cut(self.training, self.epoch_ends(0)[:SCALE_WINDOWS], self.settings.windows)
        return torch.from_numpy(windows.tv), torch.from_numpy(windows.uv)

    def epoch_ends(self, epoch: int) -> Ends:
        """The epoch's training windows of known intentions, shuffled."""
        settings = self.settings
        ends = draw_ends(
            self.training, settings.windows, "train", settings.seed, epoch, per_record=settings.ends_per_record
        )
        return ends[stream("shuffle", settings.seed, epoch).permutation(len(ends))]

    def epoch_windows(self, epoch: int) -> Labelled:
        """The epoch's training windows with their labels, shuffled; with outlier exposure preludes are among them."""
        settings, ends = self.settings, self.epoch_ends(epoch)
        label = self.training.label[ends.row]
        if not settings.loss.exposure_weight:
            return ends, label
        seen = prelude_windows(settings.windows, settings.preludes)
        outliers = draw_ends(self.training, seen, "exposure", settings.seed, epoch, per_record=settings.ends_per_record)
        both = Ends(*(np.concatenate(parts) for parts in ((ends.row, outliers.row), (ends.step, outliers.step))))
        label = np.concatenate([label, np.full(len(outliers), OUTLIER)])
        order = stream("shuffle exposed", settings.seed, epoch).permutation(len(both))
        return both[order], label[order]

    def train_dataloader(self) -> DataLoader[Batch]:
        count = len(self.epoch_windows(0)[0])
        return self._loader(self.training, lambda: self.epoch_windows(self._epoch()), count, self._varied)

    def val_dataloader(self) -> DataLoader[Batch]:
        fixed = self.fixed, self.validation.label[self.fixed.row]
        return self._loader(self.validation, lambda: fixed, len(self.fixed))

    def state_dict(self) -> dict[str, Any]:
        return {"next_epoch": self._epoch() + 1}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.next_epoch = state["next_epoch"]

    def _epoch(self) -> int:
        # A resumed trainer counts itself forward only after it has asked for the first batch.
        assert self.trainer is not None
        return max(int(self.trainer.current_epoch), self.next_epoch)

    def _loader(
        self, records: Records, windows: Callable[[], Labelled], n: int, vary: Vary | None = None
    ) -> DataLoader[Batch]:
        return DataLoader(WindowBatches(records, windows, n, self.settings, vary), batch_size=None)

    def _varied(self, k: int, windows: Windows, label: IntArray) -> tuple[Windows, IntArray]:
        """The k-th batch of the epoch, augmented."""
        rng = stream("augment", self.settings.seed, self._epoch(), k)
        return augmented(windows, label, self.settings.augment, rng)


class WindowBatches(IterableDataset[Batch]):
    """Batches of windows with their labels, cut when they are asked for.

    windows: ends and labels, asked anew whenever an iteration starts. n: how many they are.
    vary: what becomes of a batch.
    """

    def __init__(
        self, records: Records, windows: Callable[[], Labelled], n: int, settings: TrainSettings, vary: Vary | None
    ) -> None:
        self.records, self.windows, self.n, self.settings = records, windows, n, settings
        self.vary = vary

    def __len__(self) -> int:
        return math.ceil(self.n / self.settings.optimiser.batch)

    def __iter__(self) -> Iterator[Batch]:
        (ends, label), size = self.windows(), self.settings.optimiser.batch
        parts = batches(self.records, ends, self.settings.windows, size)
        for k, (windows, part) in enumerate(zip(parts, np.split(label, range(size, len(label), size)), strict=True)):
            seen, said = (windows, part) if self.vary is None else self.vary(k, windows, part)
            yield torch.from_numpy(seen.tv), torch.from_numpy(seen.uv), torch.from_numpy(said)


class Lesson(lightning.LightningModule):
    """The network's loss, Adam, and validation macro-F1 around a network."""

    def __init__(self, network: WindowNetwork, settings: TrainSettings, alpha: Tensor | None) -> None:
        super().__init__()
        self.network, self.settings = network, settings
        self.register_buffer("alpha", alpha)
        self.f1 = MulticlassF1Score(network.n_classes, average="macro")

    def training_step(self, batch: Batch, k: int) -> Tensor:
        # Dropout has a seed of its own in every step, so that a resumed training draws what an unbroken one would.
        torch.manual_seed(torch_seed("dropout", self.settings.seed, self.current_epoch, k))
        said = self.network.answers(batch[0], batch[1])
        outlier = batch[2] == OUTLIER
        if outlier.any():
            loss = self.settings.loss.exposure_weight * exposure_loss(said["joint"][outlier])
            if not outlier.all():
                loss = loss + self._loss({name: x[~outlier] for name, x in said.items()}, batch[2][~outlier])
        else:
            loss = self._loss(said, batch[2])
        self.log("train_loss", loss, on_step=False, on_epoch=True, batch_size=len(batch[2]))
        return loss

    def validation_step(self, batch: Batch, _: int) -> None:
        said = self.network.answers(batch[0], batch[1])
        logits = said["joint"]
        self.f1(logits, batch[2])
        n = len(batch[2])
        self.log("validation_loss", self._loss(said, batch[2]), batch_size=n)
        self.log("validation_accuracy", (logits.argmax(1) == batch[2]).float().mean(), batch_size=n)
        self.log(MONITOR, self.f1, on_epoch=True, batch_size=n)

    def configure_optimizers(self) -> Any:
        settings = self.settings.optimiser
        adam = torch.optim.AdamW(
            self.parameters(), settings.learning_rate, settings.betas, weight_decay=settings.weight_decay
        )
        if settings.schedule == "constant":
            return adam
        total = int(self.trainer.estimated_stepping_batches)
        rise = max(1, round(settings.warmup_share * total))

        def factor(step: int) -> float:
            if step < rise:
                return (step + 1) / rise
            return 0.5 * (1 + math.cos(math.pi * (step - rise) / max(1, total - rise)))

        schedule = torch.optim.lr_scheduler.LambdaLR(adam, factor)
        return {"optimizer": adam, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def _loss(self, said: dict[str, Tensor], label: Tensor) -> Tensor:
        return self.network.loss(said, label, self.get_buffer("alpha"), self.settings.loss.gamma)


class History(Callback):
    """One row an epoch, written to a CSV file and kept in the checkpoints."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        row = {name: float(value) for name, value in trainer.callback_metrics.items()}
        row["learning_rate"] = float(trainer.optimizers[0].param_groups[0]["lr"])
        self.rows.append({"epoch": float(trainer.current_epoch), **row})
        table = pd.DataFrame(self.rows).astype({"epoch": int})
        replace_file(self.path, lambda path: table.to_csv(path, index=False))

    @property
    def state_key(self) -> str:
        return "History"

    def state_dict(self) -> dict[str, Any]:
        return {"rows": self.rows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.rows = list(state["rows"])
