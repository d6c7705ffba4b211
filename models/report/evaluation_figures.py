"""The figures that belong to one evaluation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.metrics import roc_curve

from isacsim.arrays import Array
from isacsim.errors import InputError
from labeling.intentions import over_text
from models.evaluation import repeats
from models.evaluation.evaluation import Evaluation
from models.evaluation.repeats import Measured
from models.networks.checkpoints import HISTORY_FILE
from models.report import figures
from models.scores import open_set

HISTORY_COLUMNS = ["epoch", "train_loss", "validation_loss", "validation_macro_f1", "validation_accuracy"]


def draw_figures(evaluation: Evaluation, folder: Path) -> None:
    """Draw the figures of an evaluation into a folder, as PNG files.

    Figures with a line for each predictor show the first run of those that differ in the training seed alone.
    Raises InputError where the training history of the evaluated run is damaged.
    """
    evaluated = evaluation.measured[0]
    run, result = evaluated.run, evaluation.result
    side_by_side = [group[0].result for group in repeats.grouped(evaluation.measured)]
    has_following = bool(evaluated.predictions.unknown.any())
    figures.confusion(np.array(result.confusion), result.classes, folder / "confusion.png", run.name)
    by_lead_time = {shown.name: shown.by_lead_time for shown in side_by_side}
    figures.lead_time(by_lead_time, folder / "lead_time.png")
    if has_following:
        figures.unknown_lead_time(by_lead_time, folder / "unknown_lead_time.png")
        figures.unknown_roc(_roc_curves(evaluated), folder / "unknown_roc.png")
    if (curve := result.windows.window_end_curve) is not None:
        by_end = {shown.name: shown.by_window_end or [] for shown in side_by_side}
        figures.window_end(by_end, curve.relative_to, folder / "window_end.png")
        if has_following:
            figures.unknown_window_end(by_end, curve.relative_to, folder / "unknown_window_end.png")
    trained = {f"within {part.within_s:g} s": part.trained for part in result.passing or ()}
    if curves := {name: answer.reliability for name, answer in trained.items() if answer is not None}:
        figures.reliability(curves, folder / "passing.png")
    if (run.path / HISTORY_FILE).exists():
        over = over_text(run.card.validated, run.card.classes)
        figures.loss_curves(read_history(run.path / HISTORY_FILE), folder / "loss.png", over)


def read_history(path: Path) -> pd.DataFrame:
    """Return a run's history, a row for each epoch. Raises InputError where it is damaged."""
    try:
        return pd.read_csv(path, dtype=float).astype({"epoch": int})[HISTORY_COLUMNS]
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is damaged ({error}); delete it to evaluate without it") from None


def _roc_curves(measured: Measured) -> dict[str, tuple[Array, Array]]:
    """Return false- and true-positive rates of the run's own open-set score and of the plain one, by a legend text."""
    predictions, card, scores = measured.predictions, measured.run.card, open_set.of_run(measured.run)
    rows = predictions.known | predictions.unknown
    curves = {}
    for name in dict.fromkeys((card.unknown_score, open_set.PLAIN)):
        values = scores[name](predictions.outputs)
        false_positive, true_positive, _ = roc_curve(predictions.known[rows], values[rows])
        auroc = measured.result.unknown_scores[name].auroc
        curves[f"{name.replace('_', ' ')} (AUROC {auroc:.3f})"] = (false_positive, true_positive)
    return curves
