"""CaSTFormer on feature files of clips, such as those of Brain4Cars: one fold, measured at every horizon."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.on_windows.metrics import confusion
from isac_cosim.models.data.clips import Clip, load_clips
from isac_cosim.models.predictors.castformer import CastformerCore
from isac_cosim.studies.clip_validation import CLASSES, ClipSettings, folds, predict_fold
from isac_cosim.studies.reproduction.experiments.paper_figures import HORIZONS_S
from isac_cosim.studies.reproduction.experiments.trainings import Scores

CLIP_S = 5.0
"""Length of a clip, s. Source: CaSTFormer, Table 3."""
PARTS = 10
"""Clips of a fold are counted in so many parts, which are the units of the intervals."""


@dataclass(frozen=True)
class ClipTraining:
    """One fold of clips: a network trained on whole clips and measured on clips that end early.

    folder: of the clips. castformer: settings of the network. folds, fold: number of folds, and of this one.
    background: the class that is no maneuver, if there is one. classes: their number. held_out: names of the clips of
    this fold; None for folds that hold each class evenly. training_seed: of weights, frames and batches; folds do not
    depend on it.
    """

    name: str
    scores_file: Path
    folder: Path
    castformer: dict[str, Any]
    folds: int
    fold: int
    epochs: int
    background: int | None
    classes: int = CLASSES
    held_out: tuple[str, ...] | None = None
    training_seed: int = 0


def clips_in(folder: Path, classes: int = CLASSES) -> list[Clip]:
    """Return the clips in a folder. Raises InputError where there are none."""
    if not folder.is_dir():
        raise InputError(f"--clips {folder}: no such folder; give the folder of the .npz feature files")
    return load_clips(folder, classes)


def shortened(clip: Clip, horizon_s: float) -> Clip:
    """Return a clip without its last `horizon_s` seconds, but with at least one frame."""
    kept = max(1, round(len(clip.inner) * (1 - horizon_s / CLIP_S)))
    return replace(clip, inner=clip.inner[:kept], outer=clip.outer[:kept])


@limited()
def measure_clips(task: ClipTraining) -> Scores:
    """Train a network on the clips outside a fold, and measure it on those of the fold at every horizon."""
    clips = clips_in(task.folder, task.classes)
    content = {
        "castformer": task.castformer,
        "folds": task.folds,
        "epochs": task.epochs,
        "background": task.background,
        "classes": task.classes,
    }
    settings = checked(ClipSettings, content, task.name)
    if task.held_out is None:
        train, test = folds(np.array([clip.label for clip in clips], dtype=np.int64), settings)[task.fold]
    else:
        held_out_names = np.isin([clip.name for clip in clips], task.held_out)
        train, test = np.flatnonzero(~held_out_names), np.flatnonzero(held_out_names)
    settings = settings.model_copy(update={"seed": task.training_seed})
    held_out = [shortened(clips[i], horizon_s) for horizon_s in HORIZONS_S for i in test]
    began = time.process_time()
    predicted = predict_fold([clips[i] for i in train], held_out, settings, task.fold)
    label = np.array([clips[i].label for i in test], dtype=np.int64)
    part = np.arange(len(test)) % PARTS
    counts = {
        str(horizon_s): {
            f"fold {task.fold}, part {k}": confusion(label[part == k], answer[part == k], settings.classes).tolist()
            for k in range(PARTS)
            if (part == k).any()
        }
        for horizon_s, answer in zip(HORIZONS_S, predicted.reshape(len(HORIZONS_S), -1), strict=True)
    }
    widths = clips[0].inner.shape[1], clips[0].outer.shape[1]
    network = CastformerCore(settings.castformer, settings.classes, *widths, speed=True)
    return Scores(
        name=task.name,
        training_seed=settings.seed,
        counts=counts,
        windows={str(horizon_s): len(test) for horizon_s in HORIZONS_S},
        parameters=sum(parameter.numel() for parameter in network.parameters()),
        cpu_s=round(time.process_time() - began, 1),
    )
