"""Cross-validation of CaSTFormer on per-clip feature files (`models.data.clips`), e.g. those of Brain4Cars.

The clips are dealt into folds, each class evenly. Every fold is predicted once, by a network trained on the others for
a fixed number of epochs: nothing is chosen on the clips that are measured.

Run: python -m models.studies.clip_validation FOLDER
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from pydantic import Field
from sklearn.model_selection import StratifiedKFold
from torch import Tensor

from isacsim.arrays import IntArray
from isacsim.errors import InputError
from isacsim.seeding import stream
from isacsim.settings import Settings
from models.data.clips import Clip, ClipBatch, batch, load_clips
from models.evaluation import metrics
from models.predictors.castformer import CastformerCore, CastformerSettings, castformer_loss


class ClipSettings(Settings):
    """How CaSTFormer is trained and measured on clips; epochs, batch, learning rate and folds are the paper's."""

    classes: int = Field(5, ge=2, description="number of classes; Brain4Cars has 5")
    background: int | None = Field(
        None, ge=0, description="the class that is no maneuver (driving straight), which Eq. (13) leaves out, if any"
    )
    frames: int = Field(20, ge=2, description="frames of a clip that the network sees, evenly spaced")
    castformer: CastformerSettings = CastformerSettings(intent_source="out")
    folds: int = Field(5, ge=2, description="parts that are held out in turn")
    epochs: int = Field(160, ge=1, description="epochs of each fold")
    batch: int = Field(16, ge=1, description="clips a step")
    learning_rate: float = Field(1e-3, gt=0, description="of Adam")
    seed: int = Field(0, description="of folds, initial weights, frames and batches")


def cross_validate(clips: list[Clip], settings: ClipSettings) -> dict[str, Any]:
    """Predict every clip by a network that was not trained on it.

    Returns `accuracy` and Eq. (13)'s `precision`, `recall` and `f1`, each with mean and spread over the folds; `folds`
    with those of each; `confusion` and `accuracy_of_all` of all clips together. InputError where there are fewer clips
    of every class than folds.
    """
    label = np.array([clip.label for clip in clips], dtype=np.int64)
    said, rows = np.zeros(len(clips), dtype=np.int64), []
    for k, (train, test) in enumerate(folds(label, settings)):
        said[test] = predict_fold([clips[i] for i in train], [clips[i] for i in test], settings, k)
        counts = metrics.confusion(label[test], said[test], settings.classes)
        scores = metrics.maneuver_scores(counts, settings.background)
        rows.append({"n": len(test), "accuracy": float(np.mean(label[test] == said[test])), **scores})
    return {
        **{name: metrics.spread([row[name] for row in rows]) for name in ("accuracy", "precision", "recall", "f1")},
        "accuracy_of_all": float(np.mean(label == said)),
        "confusion": metrics.confusion(label, said, settings.classes).tolist(),
        "folds": rows,
        "settings": settings.model_dump(mode="json"),
    }


def folds(label: IntArray, settings: ClipSettings) -> list[tuple[IntArray, IntArray]]:
    """Rows of the clips trained on and held out, of each fold; label: (n,)."""
    if np.bincount(label).max() < settings.folds:
        raise InputError(f"{len(label)} clips are too few for {settings.folds} folds: fewer folds, or more clips")
    parts = StratifiedKFold(settings.folds, shuffle=True, random_state=settings.seed)
    return list(parts.split(np.zeros(len(label)), label))


def predict_fold(training: list[Clip], held_out: list[Clip], settings: ClipSettings, fold: int) -> IntArray:
    """Classes that a network trained on some clips gives to others, (n,); fold: names its random draws."""
    training, held_out = standardised(training, training), standardised(training, held_out)
    with torch.random.fork_rng():
        torch.manual_seed(int(stream("torch", "clips", settings.seed, fold).integers(2**62)))
        network = _trained(training, settings, fold)
    with torch.inference_mode():
        said: Tensor = network.eval()(*_tensors(batch(held_out, settings.frames)))
    return np.asarray(said.argmax(dim=1).numpy(), dtype=np.int64)


def standardised(training: list[Clip], clips: list[Clip]) -> list[Clip]:
    """Clips with every feature by its mean and standard deviation over all frames of the training clips."""
    inner, outer = (np.concatenate([getattr(clip, name) for clip in training]) for name in ("inner", "outer"))
    (m_in, s_in), (m_out, s_out) = ((x.mean(axis=0), x.std(axis=0) + 1e-6) for x in (inner, outer))
    return [replace(c, inner=(c.inner - m_in) / s_in, outer=(c.outer - m_out) / s_out) for c in clips]


def _trained(clips: list[Clip], settings: ClipSettings, fold: int) -> CastformerCore:
    widths = clips[0].inner.shape[1], clips[0].outer.shape[1]
    network = CastformerCore(settings.castformer, settings.classes, *widths, speed=True)
    adam = torch.optim.Adam(network.parameters(), settings.learning_rate)
    for epoch in range(settings.epochs):
        order = stream("clip order", settings.seed, fold, epoch).permutation(len(clips))
        for at in range(0, len(clips), settings.batch):
            some = [clips[i] for i in order[at : at + settings.batch]]
            drawn = batch(some, settings.frames, settings.seed, fold, epoch)
            said = network.training_logits(*_tensors(drawn))
            loss = castformer_loss(said, torch.from_numpy(drawn.label), None, settings.castformer.alpha)
            adam.zero_grad()
            torch.autograd.backward(loss)
            adam.step()
    return network


def _tensors(clips: ClipBatch) -> tuple[Tensor, Tensor, Tensor]:
    return torch.from_numpy(clips.inner), torch.from_numpy(clips.outer), torch.from_numpy(clips.speed)


if __name__ == "__main__":
    chosen = ClipSettings()
    print(json.dumps(cross_validate(load_clips(sys.argv[1], chosen.classes), chosen), indent=1))
