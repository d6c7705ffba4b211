"""What Lightning runs: the windows of every epoch, the loss and its optimiser, the history, the progress bar."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import lightning
import numpy as np
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset
from torchmetrics.classification import MulticlassF1Score

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import RunError
from isac_cosim.base.feedback import Feedback, Move
from isac_cosim.base.files import replace_file
from isac_cosim.base.seeding import stream
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.augment import AugmentSettings, augmented
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.labelled_windows import epoch_ends, validation_ends
from isac_cosim.models.data.pre_onset import pre_onset_windows
from isac_cosim.models.data.windows import Ends, Records, Windows, cut, draw_ends
from isac_cosim.models.networks.losses import exposure_loss
from isac_cosim.models.networks.network import WindowNetwork, torch_seed

MONITOR = "validation_macro_f1"
"""The score that chooses the best epoch."""
SCALE_WINDOWS = 2000
"""At most so many windows are standardised by."""
OUTLIER = -1
"""The label of a window that shows no intention."""
Batch = tuple[Tensor, Tensor, Tensor]
"""Windows of the TV (B, 6, T) and of the UV (B, 6, U), and labels (B,)."""
Variation = Callable[[int, Windows, IntArray], tuple[Windows, IntArray]]
"""Takes the number of a batch within its epoch, its windows and labels, and returns those to train on instead."""
LabelledEnds = tuple[Ends, IntArray]


class ResumedData(lightning.LightningDataModule):
    """Data that differ from epoch to epoch, also where a training goes on from a checkpoint."""

    def __init__(self) -> None:
        super().__init__()
        self.next_epoch = 0

    @property
    def epoch(self) -> int:
        """The number of the present epoch, from 0."""
        # A resumed trainer counts itself forward only after it has asked for the first batch.
        assert self.trainer is not None
        return max(int(self.trainer.current_epoch), self.next_epoch)

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint keeps of the data: the epoch to go on with."""
        return {"next_epoch": self.epoch + 1}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on with the epoch that a checkpoint names."""
        self.next_epoch = state["next_epoch"]


class WindowData(ResumedData):
    """Training windows, drawn anew in each epoch, and fixed validation windows."""

    def __init__(self, training: Records, validation: Records, settings: FitSettings) -> None:
        super().__init__()
        self.training, self.validation, self.settings = training, validation, settings
        self.fixed = validation_ends(validation, settings)

    @property
    def validated(self) -> list[Intention]:
        """The intentions that have a validation window."""
        present = set(self.validation.label[self.fixed.row].tolist())
        return [intention for intention in KNOWN if intention in present]

    def first_windows(self) -> tuple[Tensor, Tensor]:
        """Return windows of the first epoch to standardise by, at most SCALE_WINDOWS: (n, 6, T) and (n, 6, U)."""
        windows = cut(self.training, self.epoch_ends(0)[:SCALE_WINDOWS], self.settings.windows)
        return torch.from_numpy(windows.tv), torch.from_numpy(windows.uv)

    def epoch_ends(self, epoch: int) -> Ends:
        """Return the ends of an epoch's training windows of known intentions, shuffled."""
        return epoch_ends(self.training, self.settings, epoch)

    def epoch_windows(self, epoch: int) -> LabelledEnds:
        """Return the ends and labels of an epoch's training windows, shuffled.

        With outlier exposure there are as many pre-onset windows among them, whose label is OUTLIER.
        """
        settings, ends = self.settings, self.epoch_ends(epoch)
        label = self.training.label[ends.row]
        if not settings.loss.exposure_weight:
            return ends, label
        before = pre_onset_windows(settings.windows, settings.pre_onset)
        outliers = draw_ends(
            self.training, before, "exposure", settings.seed, epoch, per_record=settings.ends_per_record
        )
        both = Ends(*(np.concatenate(parts) for parts in ((ends.row, outliers.row), (ends.step, outliers.step))))
        label = np.concatenate([label, np.full(len(outliers), OUTLIER)])
        order = stream("shuffle exposed", settings.seed, epoch).permutation(len(both))
        return both[order], label[order]

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return the training windows; each iteration draws those of the current epoch."""
        count = len(self.epoch_windows(0)[0])
        # Variation draws for whole batches, so that without it a device need not read the windows of the others.
        variation = self._varied if self.settings.augment != AugmentSettings() else None
        return self._loader(self.training, lambda: self.epoch_windows(self.epoch), count, variation)

    def val_dataloader(self) -> DataLoader[Batch]:
        """Return the validation windows, the same in every epoch."""
        fixed = self.fixed, self.validation.label[self.fixed.row]
        return self._loader(self.validation, lambda: fixed, len(self.fixed))

    def _loader(
        self, records: Records, windows: Callable[[], LabelledEnds], n: int, variation: Variation | None = None
    ) -> DataLoader[Batch]:
        assert self.trainer is not None
        share = Share(self.trainer.global_rank, self.trainer.world_size)
        return DataLoader(WindowBatches(records, windows, n, self.settings, variation, share), batch_size=None)

    def _varied(self, k: int, windows: Windows, label: IntArray) -> tuple[Windows, IntArray]:
        """Return the k-th batch of the current epoch, augmented."""
        rng = stream("augment", self.settings.seed, self.epoch, k)
        return augmented(windows, label, self.settings.augment, rng)


@dataclass(frozen=True)
class Share:
    """The part of each batch that one of several devices works on: rows `rank`, `rank + count`, ..."""

    rank: int = 0
    count: int = 1

    def rows(self, size: int) -> IntArray:
        """Return the rows of a batch of some size. A device that would have none takes a row of another one."""
        return np.arange(self.rank % size, size, self.count)


class WindowBatches(IterableDataset[Batch]):
    """Batches of windows with their labels, cut one after the other.

    windows: returns ends and labels; it is called whenever an iteration starts. n: how many they are.
    variation: is applied to every batch, if given. share: the part of each batch that is returned.
    """

    def __init__(
        self,
        records: Records,
        windows: Callable[[], LabelledEnds],
        n: int,
        settings: FitSettings,
        variation: Variation | None,
        share: Share,
    ) -> None:
        self.records, self.windows, self.n, self.settings = records, windows, n, settings
        self.variation, self.share = variation, share

    def __len__(self) -> int:
        return math.ceil(self.n / self.settings.optimiser.batch)

    def __iter__(self) -> Iterator[Batch]:
        ends, label = self.windows()
        size = self.settings.optimiser.batch
        for k, start in enumerate(range(0, len(ends), size)):
            batch = np.arange(start, min(start + size, len(ends)))
            own = self.share.rows(len(batch))
            if self.variation is None:
                batch, own = batch[own], np.arange(len(own))
            windows, labels = cut(self.records, ends[batch], self.settings.windows), label[batch]
            if self.variation is not None:
                windows, labels = self.variation(k, windows, labels)
            tv, uv, labels = windows.tv[own], windows.uv[own], labels[own]
            yield torch.from_numpy(tv), torch.from_numpy(uv), torch.from_numpy(labels)


@dataclass(frozen=True)
class Monitor:
    """The score that chooses the best epoch.

    mode: whether the lowest or the highest is best. shown: its name beside progress bars. over: over which intentions
    it is a mean, if not all.
    """

    name: str
    mode: Literal["min", "max"]
    shown: str
    over: str = ""


class DivergedError(RunError):
    """The loss of a training is not finite."""


class TrainedModule(lightning.LightningModule):
    """A network with its loss and its optimiser."""

    network: Any
    settings: FitSettings

    def configure_optimizers(self) -> Any:
        """Return AdamW and its schedule, in the form that Lightning expects."""
        settings = self.settings.optimiser
        # One call for all parameters. In mixed precision, Lightning does not clip the gradients of a fused optimiser.
        adam = torch.optim.AdamW(
            self.parameters(), settings.learning_rate, settings.betas, weight_decay=settings.weight_decay,
            fused=settings.precision == "32-true",
        )  # fmt: skip
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

    @property
    def is_shared(self) -> bool:
        """Whether several devices share each batch."""
        return self.trainer.world_size > 1

    def refuse_nonfinite(self, loss: Tensor, batch: str) -> None:
        """Raise DivergedError where a loss is NaN or infinite: whatever is learnt from it on is, too."""
        if not torch.isfinite(loss):
            optimiser = self.settings.optimiser
            unclipped = "" if optimiser.clip_norm else ", and clip gradients (clip_norm = 1)"
            raise DivergedError(
                f"{self.settings.model}: the loss of {batch} in epoch {self.current_epoch + 1} is {loss.item()}: the "
                f"training stopped; lower training.optimiser.learning_rate, now {optimiser.learning_rate}{unclipped}"
            )


class NetworkModule(TrainedModule):
    """A network with its loss, its optimiser and its validation macro-F1.

    alpha: class weights (n_classes,), all 1 if None.
    """

    def __init__(self, network: WindowNetwork, settings: FitSettings, alpha: Tensor | None) -> None:
        super().__init__()
        self.network, self.settings = network, settings
        self.register_buffer("alpha", alpha)
        self.f1 = MulticlassF1Score(network.n_classes, average="macro")

    def training_step(self, batch: Batch, k: int) -> Tensor:
        """Return the loss of the k-th batch of an epoch; outliers in it add the exposure loss."""
        # Every step seeds its own dropout, so that a resumed training draws what an uninterrupted one would.
        torch.manual_seed(torch_seed("dropout", self.settings.seed, self.current_epoch, k))
        logits, label = self.network.training_logits(batch[0], batch[1]), batch[2]
        outlier = label == OUTLIER
        if outlier.any():
            loss = self.settings.loss.exposure_weight * exposure_loss(logits["joint"][outlier])
            if not outlier.all():
                loss = loss + self._loss({name: x[~outlier] for name, x in logits.items()}, label[~outlier])
        else:
            loss = self._loss(logits, label)
        self.refuse_nonfinite(loss, f"batch {k + 1}")
        self.log("train_loss", loss, on_step=False, on_epoch=True, batch_size=len(label), sync_dist=self.is_shared)
        return loss

    def validation_step(self, batch: Batch, k: int) -> None:
        """Log loss, accuracy and macro-F1 of a batch of validation windows."""
        logits, label = self.network.training_logits(batch[0], batch[1]), batch[2]
        joint, loss = logits["joint"], self._loss(logits, label)
        self.refuse_nonfinite(loss, f"validation batch {k + 1}")
        self.f1(joint, label)
        accuracy = (joint.argmax(1) == label).float().mean()
        for name, value in (("validation_loss", loss), ("validation_accuracy", accuracy)):
            self.log(name, value, batch_size=len(label), sync_dist=self.is_shared)
        self.log(MONITOR, self.f1, on_epoch=True, batch_size=len(label))

    def _loss(self, logits: dict[str, Tensor], label: Tensor) -> Tensor:
        network: WindowNetwork = self.network
        return network.loss(logits, label, self.get_buffer("alpha"), self.settings.loss.gamma)


class History(Callback):
    """The history of a training: one row per epoch, in a CSV file and in the checkpoints."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        """Add the row of the epoch, and write the file."""
        row = {name: float(value) for name, value in trainer.callback_metrics.items()}
        row["learning_rate"] = float(trainer.optimizers[0].param_groups[0]["lr"])
        self.rows.append({"epoch": float(trainer.current_epoch), **row})
        if not trainer.is_global_zero:
            return
        table = pd.DataFrame(self.rows).astype({"epoch": int})
        replace_file(self.path, lambda path: table.to_csv(path, index=False))

    @property
    def state_key(self) -> str:
        """The name under which checkpoints keep the rows."""
        return "History"

    def state_dict(self) -> dict[str, Any]:
        """Return the rows, for a checkpoint."""
        return {"rows": self.rows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take the rows from a checkpoint."""
        self.rows = list(state["rows"])


class EpochProgress(Callback):
    """The progress of a training: a bar of the batches that are done, and a line about every epoch.

    history: adds its row of an epoch before this says anything. name: of the predictor. monitor: the score that is
    shown.
    """

    def __init__(self, feedback: Feedback, history: History, name: str, monitor: Monitor) -> None:
        self.feedback, self.history, self.name, self.monitor = feedback, history, name, monitor
        self.bar = ExitStack()
        self.move: Move | None = None
        self.done, self.total, self.note = 0, 1, ""

    def on_train_start(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        """Open the bar."""
        if not trainer.is_global_zero:
            return
        assert trainer.max_epochs is not None
        batches = int(trainer.num_training_batches)
        self.done, self.total = trainer.current_epoch * batches, trainer.max_epochs * batches
        self.move = self.bar.enter_context(self.feedback.bar(f"training {self.name}"))
        self.move(self.done, self.total)

    def on_train_batch_end(self, *_: Any, **__: Any) -> None:
        """Move the bar by a batch."""
        self.done += 1
        self._show()

    def on_validation_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        """Show the score of the epoch."""
        score, shown = trainer.callback_metrics.get(self.monitor.name), self.monitor.shown
        if score is not None:
            epoch = f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}"
            self.note = f"{epoch}, {shown} {float(score):.3f}{self.monitor.over}"
            self._show()

    def on_train_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        """Say what the epoch has taught, in a line that stays."""
        if not trainer.is_global_zero:
            return
        rows, monitor = self.history.rows, self.monitor
        best = (max if monitor.mode == "max" else min)(row[monitor.name] for row in rows)
        score = f"validation {monitor.shown} {rows[-1][monitor.name]:.3f}{monitor.over}, best {best:.3f}"
        epoch = f"{self.name}, epoch {trainer.current_epoch + 1}/{trainer.max_epochs}"
        self.feedback.message(f"{epoch}: {score}; training loss {rows[-1]['train_loss']:.3g}")

    def on_train_end(self, *_: Any) -> None:
        """Close the bar."""
        self.bar.close()

    def on_exception(self, *_: Any) -> None:
        """Close the bar."""
        self.bar.close()

    def _show(self) -> None:
        if self.move is not None:
            self.move(self.done, self.total, self.note)
