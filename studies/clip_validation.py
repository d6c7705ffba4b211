"""Cross-validates CaSTFormer on per-clip feature files (`models.data.clips`), e.g. those of Brain4Cars.

The clips are split into folds, each class evenly. Each fold is predicted once, by a network trained on the others for
a fixed number of epochs: nothing is chosen on the clips that are measured.

Run: python -m isac_cosim.studies.clip_validation FOLDER [BACKGROUND]

BACKGROUND is the number of the class that drives straight on, or `none`; without it, the clips' files have to say.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Self

import numpy as np
import torch
from pydantic import Field, model_validator
from sklearn.model_selection import StratifiedKFold
from torch import Tensor

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.files import json_text
from isac_cosim.base.seeding import stream
from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Settings
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.maneuvers import maneuver_scores
from isac_cosim.evaluation.on_windows.score_results import Spread
from isac_cosim.models.data.clips import NO_BACKGROUND, Clip, ClipBatch, batch, load_clips
from isac_cosim.models.predictors.castformer import CastformerCore, CastformerSettings, castformer_loss

CLASSES = 5
"""Number of classes of Brain4Cars."""


class ClipSettings(Settings):
    """How CaSTFormer is trained and measured on clips; epochs, batch, learning rate and folds are the paper's."""

    classes: int = Field(CLASSES, ge=2, le=10_000, description="number of classes; Brain4Cars has 5")
    background: int | None = Field(
        ge=0,
        le=1_000_000,
        description="class that is not a maneuver (driving straight), which Eq. (13) leaves out; null for none",
    )
    frames: int = Field(20, ge=2, le=10_000, description="frames of a clip that the network sees, evenly spaced")
    castformer: CastformerSettings = CastformerSettings(intent_source="out")
    folds: int = Field(5, ge=2, le=1000, description="parts, each held out in turn")
    epochs: int = Field(160, ge=1, le=1_000_000, description="epochs of each fold")
    batch: int = Field(16, ge=1, le=1_000_000, description="clips per training step")
    learning_rate: float = Field(1e-3, gt=0, le=1e9, description="learning rate of Adam")
    seed: Seed = Field(0, description="seed of folds, initial weights, frames and batches")

    @model_validator(mode="after")
    def _background_is_a_class(self) -> Self:
        if self.background is not None and self.background >= self.classes:
            raise ValueError(f"background {self.background} is not one of the {self.classes} classes")
        return self


def background_of(clips: list[Clip], stated: str | None, classes: int = CLASSES) -> int | None:
    """Return the class that drives straight on, None where every class is a maneuver.

    stated: its number, or `none`, as the user gives it; None to read it from the clips' files. Raises InputError where
    neither says, or the two contradict each other.
    """
    stored = clips[0].background
    if stated is None:
        if stored is None:
            raise InputError(
                "the clips do not say which class drives straight on, which Eq. (13) counts apart: give its number "
                "with --background, or --background none if every class is a maneuver"
            )
        return None if stored == NO_BACKGROUND else stored
    number = NO_BACKGROUND if stated == "none" else int(stated) if stated.isascii() and stated.isdigit() else classes
    if number >= classes:
        raise InputError(f"--background {stated}: give a class from 0 to {classes - 1}, or none")
    if stored is not None and stored != number:
        raise InputError(
            f"--background {stated}: the files of the clips say {stored}; remove the option, or correct them"
        )
    return None if number == NO_BACKGROUND else number


class FoldScores(Settings):
    """Scores of one fold.

    n: number of clips.
    accuracy: share of clips classified correctly.
    precision, recall, f1: over maneuvers; None without a maneuver. Source: CaSTFormer, Eq. (13).
    """

    n: int
    accuracy: float
    precision: float | None
    recall: float | None
    f1: float | None


class ClipResult(Settings):
    """What a cross-validation measured.

    accuracy, precision, recall, f1: mean and spread over the folds of the scores of `FoldScores`.
    accuracy_of_all: accuracy over all clips together.
    confusion: number of clips, G x G, rows true and columns predicted.
    folds: scores of each fold.
    settings: behind the result.
    """

    accuracy: Spread
    precision: Spread
    recall: Spread
    f1: Spread
    accuracy_of_all: float
    confusion: list[list[int]]
    folds: list[FoldScores]
    settings: ClipSettings


@limited()
def cross_validate(clips: list[Clip], settings: ClipSettings) -> ClipResult:
    """Predict every clip by a network that was not trained on it, and return the scores.

    Raises InputError where no class has as many clips as there are folds.
    """
    label = np.array([clip.label for clip in clips], dtype=np.int64)
    predicted, rows = np.zeros(len(clips), dtype=np.int64), []
    for k, (train, test) in enumerate(folds(label, settings)):
        predicted[test] = predict_fold([clips[i] for i in train], [clips[i] for i in test], settings, k)
        counts = metrics.confusion(label[test], predicted[test], settings.classes)
        scores = maneuver_scores(counts, settings.background)
        accuracy = float(np.mean(label[test] == predicted[test]))
        rows.append(FoldScores(n=len(test), accuracy=accuracy, **dict(scores)))
    return ClipResult(
        accuracy=metrics.spread([row.accuracy for row in rows]),
        precision=metrics.spread([row.precision for row in rows]),
        recall=metrics.spread([row.recall for row in rows]),
        f1=metrics.spread([row.f1 for row in rows]),
        accuracy_of_all=float(np.mean(label == predicted)),
        confusion=metrics.confusion(label, predicted, settings.classes).tolist(),
        folds=rows,
        settings=settings,
    )


def folds(label: IntArray, settings: ClipSettings) -> list[tuple[IntArray, IntArray]]:
    """Return the rows of the clips trained on and of those held out, for each fold; label: class numbers, (n,)."""
    if np.bincount(label).max() < settings.folds:
        raise InputError(
            f"{len(label)} clips are too few for {settings.folds} folds: choose fewer folds, or give more clips"
        )
    parts = StratifiedKFold(settings.folds, shuffle=True, random_state=settings.seed)
    return list(parts.split(np.zeros(len(label)), label))


def predict_fold(training: list[Clip], held_out: list[Clip], settings: ClipSettings, fold: int) -> IntArray:
    """Return the classes that a network trained on some clips predicts for others, (n,).

    held_out: the n clips to predict. fold: number of the fold, on which the random draws depend.
    """
    training, held_out = standardised(training, training), standardised(training, held_out)
    with torch.random.fork_rng():
        torch.manual_seed(int(stream("torch", "clips", settings.seed, fold).integers(2**62)))
        network = _trained(training, settings, fold)
    with torch.inference_mode():
        logits: Tensor = network.eval()(*_tensors(batch(held_out, settings.frames)))
    return np.asarray(logits.argmax(dim=1).numpy(), dtype=np.int64)


def standardised(training: list[Clip], clips: list[Clip]) -> list[Clip]:
    """Return clips with every feature standardised by its mean and deviation over all frames of the training clips."""
    inner, outer = (np.concatenate([getattr(clip, name) for clip in training]) for name in ("inner", "outer"))
    (m_in, s_in), (m_out, s_out) = ((x.mean(axis=0), x.std(axis=0) + 1e-6) for x in (inner, outer))
    return [replace(c, inner=(c.inner - m_in) / s_in, outer=(c.outer - m_out) / s_out) for c in clips]


def _trained(clips: list[Clip], settings: ClipSettings, fold: int) -> CastformerCore:
    """Return a network trained on the clips; fold: number of the fold."""
    widths = clips[0].inner.shape[1], clips[0].outer.shape[1]
    network = CastformerCore(settings.castformer, settings.classes, *widths, speed=True)
    adam = torch.optim.Adam(network.parameters(), settings.learning_rate)
    for epoch in range(settings.epochs):
        order = stream("clip order", settings.seed, fold, epoch).permutation(len(clips))
        for start in range(0, len(clips), settings.batch):
            members = [clips[i] for i in order[start : start + settings.batch]]
            drawn = batch(members, settings.frames, settings.seed, fold, epoch)
            outputs = network.training_logits(*_tensors(drawn))
            loss = castformer_loss(outputs, torch.from_numpy(drawn.label), None, settings.castformer.alpha)
            if not torch.isfinite(loss):
                raise RunError(
                    f"clips: a loss in epoch {epoch + 1} of fold {fold + 1} is {loss.item()}, so the training stopped; "
                    f"lower learning_rate, now {settings.learning_rate}"
                )
            adam.zero_grad()
            torch.autograd.backward(loss)
            adam.step()
    return network


def _tensors(clips: ClipBatch) -> tuple[Tensor, Tensor, Tensor]:
    return torch.from_numpy(clips.inner), torch.from_numpy(clips.outer), torch.from_numpy(clips.speed)


if __name__ == "__main__":
    given = load_clips(sys.argv[1], CLASSES)
    background = background_of(given, sys.argv[2] if len(sys.argv) > 2 else None)
    result = cross_validate(given, ClipSettings(background=background))
    print(json_text(result.model_dump(mode="json"), 1))
