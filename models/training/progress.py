"""The bar of a training: epochs, validation score, time left; and the steps of a sweep."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
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


SURE_S = 60.0
"""Work after which what steps took counts as much as what was expected of them, s."""


class Steps:
    """Says what is worked on, and about how long everything that is left will take.

    expected_s: of all steps together, s. Their time left is scaled by how long those done here took, over expected.
    """

    def __init__(self, console: Console, expected_s: float) -> None:
        self.console, self.left_s = console, expected_s
        self.took_s = self.expected_s = 0.0

    def skip(self, expected_s: float) -> None:
        """Pass over what was done before."""
        self.left_s -= expected_s

    @contextmanager
    def step(self, title: str, expected_s: float, standing: bool) -> Iterator[None]:
        """Around the work of a step; standing: whether it was done before, and is passed over."""
        began = time.monotonic()
        if not standing:
            left_s = self.left_s * (self.took_s + SURE_S) / (self.expected_s + SURE_S)
            self.console.print(f"{title}; about {spoken_time(left_s)} left", highlight=False, soft_wrap=True)
        try:
            yield
        finally:
            self.left_s -= expected_s
            if not standing:
                self.took_s += time.monotonic() - began
                self.expected_s += expected_s


def spoken_time(seconds: float) -> str:
    """As people say it: `40 s`, `12 min`, `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
