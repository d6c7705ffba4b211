"""The bar of a training: epochs, validation score, time left; and the steps of a sweep."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import lightning
from lightning.pytorch.callbacks import Callback

from isacsim.feedback import Feedback, Move


class EpochProgress(Callback):
    """Reports the batches done; monitor: the score shown beside the bar."""

    def __init__(self, feedback: Feedback, name: str, monitor: str) -> None:
        self.feedback, self.name, self.monitor = feedback, name, monitor
        self.bar = ExitStack()
        self.move: Move | None = None
        self.done, self.total, self.note = 0, 1, ""

    def on_train_start(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        assert trainer.max_epochs is not None
        batches = int(trainer.num_training_batches)
        self.done, self.total = trainer.current_epoch * batches, trainer.max_epochs * batches
        self.move = self.bar.enter_context(self.feedback.bar(f"training {self.name}"))
        self.move(self.done, self.total)

    def on_train_batch_end(self, *_: Any, **__: Any) -> None:
        self.done += 1
        self._show()

    def on_validation_epoch_end(self, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
        score = trainer.callback_metrics.get(self.monitor)
        if score is not None:
            self.note = f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}, macro-F1 {float(score):.3f}"
            self._show()

    def on_train_end(self, *_: Any) -> None:
        self.bar.close()

    def on_exception(self, *_: Any) -> None:
        self.bar.close()

    def _show(self) -> None:
        if self.move is not None:
            self.move(self.done, self.total, self.note)


SURE_S = 60.0
"""Work after which what steps took counts as much as what was expected of them, s."""


class Steps:
    """Says what is worked on, and about how long everything that is left will take.

    expected_s: of all steps together, s. Their time left is scaled by how long those done here took, over expected.
    """

    def __init__(self, feedback: Feedback, expected_s: float) -> None:
        self.feedback, self.left_s = feedback, expected_s
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
            self.feedback.message(f"{title}; about {spoken_time(left_s)} left")
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
