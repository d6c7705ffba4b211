"""The bar of a training: epochs, validation score, time left."""

from __future__ import annotations

from typing import Any

import lightning
from lightning.pytorch.callbacks import Callback
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class EpochProgress(Callback):
    """Draws on a console; monitor: the score shown beside the bar."""

    def __init__(self, console: Console, name: str, monitor: str) -> None:
        self.bar = Progress(
            TextColumn("training {task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[note]}"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
            console=console, speed_estimate_period=120,
        )  # fmt: skip
        self.name, self.monitor = name, monitor
        self.task: TaskID | None = None

    def on_train_start(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        assert trainer.max_epochs is not None
        batches = int(trainer.num_training_batches)
        self.task = self.bar.add_task(self.name, total=trainer.max_epochs * batches, note="")
        # Epochs before a resumption are no measure of this one's speed, so they are not advanced but done.
        self.bar.reset(self.task, completed=trainer.current_epoch * batches)
        self.bar.start()

    def on_train_batch_end(self, *_: Any, **__: Any) -> None:
        if self.task is not None:
            self.bar.advance(self.task)

    def on_validation_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        score = trainer.callback_metrics.get(self.monitor)
        if self.task is not None and score is not None:
            note = f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}, macro-F1 {float(score):.3f}"
            self.bar.update(self.task, note=note)

    def on_train_end(self, *_: Any) -> None:
        self.bar.stop()

    def on_exception(self, *_: Any) -> None:
        self.bar.stop()
