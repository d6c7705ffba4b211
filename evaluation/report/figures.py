"""Figures of an evaluation, as PNG files.

The colours are those of Okabe and Ito, which people with colour blindness can tell apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import pandas as pd
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from sklearn.metrics import roc_curve

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.on_windows import repeats
from isac_cosim.evaluation.on_windows.evaluation import Evaluation
from isac_cosim.evaluation.on_windows.repeats import MeasuredRun
from isac_cosim.evaluation.on_windows.results import ReliabilityBin
from isac_cosim.evaluation.on_windows.score_results import LeadTimeBin, WindowEndScores
from isac_cosim.evaluation.report import figures
from isac_cosim.evaluation.report.parts import Row, write_table
from isac_cosim.labeling.intentions import KNOWN, over_text, spoken
from isac_cosim.models.networks.checkpoints import HISTORY_FILE
from isac_cosim.models.scores import open_set

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442", "#6b7280",
)  # fmt: skip
CYCLE = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, "#000000")
BY_PREDICTOR = cycler(linestyle=["-", "--"]) * cycler(color=CYCLE)
"""Lines of figures with a line for each predictor, of which there can be more than colours."""
HOLLOW = f"; hollow: over fewer than {len(KNOWN)} intentions"
"""What a title says where some points are a macro-F1 that lacks intentions."""
FALSE_KNOWN, TRUE_KNOWN, SCORE = "share of following taken for known", "share of known kept", "validation score"
"""Axes of figures, and columns of their tables."""
LEAST_WINDOWS = 20
"""Bins of lead time with fewer windows are not drawn."""
BESIDE: Any = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
"""Place of a legend with any number of predictors: beside the axes."""
BACKEND = ("backend", "backend_fallback")
"""Settings of matplotlib that choose a backend for pyplot; a figure has a canvas of its own."""
STYLE: Any = {
    "font.size": 10, "axes.titlesize": 11, "axes.titleweight": "bold", "axes.titlelocation": "left",
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#9ca3af", "axes.labelcolor": "#1f2937",
    "xtick.color": "#4b5563", "ytick.color": "#4b5563", "axes.grid": True, "grid.color": "#e5e7eb",
    "axes.axisbelow": True, "legend.frameon": False, "lines.linewidth": 1.8,
    "axes.prop_cycle": cycler(color=CYCLE),
}  # fmt: skip


@contextmanager
def figure(
    path: Path, width: float, height: float, style: Mapping[str, Any] = STYLE, dpi: float = 140
) -> Iterator[Figure]:
    """Yield an empty figure of that size, inches, and write it to `path` at the end.

    style: what is not matplotlib's default. What the user has set (matplotlibrc, MPLBACKEND, rcParams) has no part in
    the figure, and holds again afterwards. dpi: pixels per inch.
    """
    defaults = {key: value for key, value in mpl.rcParamsDefault.items() if key not in BACKEND}
    with mpl.rc_context(cast(Any, {**defaults, **style})):
        drawn = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(drawn)
        yield drawn
        replace_file(path, lambda partial: drawn.savefig(partial, dpi=dpi, metadata={"Software": None}))


def confusion(counts: Array, classes: Sequence[str], path: Path, name: str) -> None:
    """Draw a confusion matrix: shares of each row in colour, shares and numbers of windows in the cells.

    counts: (G, G), rows true and columns predicted. classes: names of the G classes. name: of the predictor.
    """
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with figure(path, 6.6, 5.6) as drawn:
        axes = drawn.subplots()
        image = axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
        for i, j in np.ndindex(*counts.shape):
            if counts[i, j]:
                colour = "white" if share[i, j] > 0.55 else "#1f2937"
                cell = f"{100 * share[i, j]:.0f} %\n{counts[i, j]}"
                axes.text(j, i, cell, ha="center", va="center", color=colour, fontsize=8.5)
        ticks = range(len(classes))
        axes.set_xticks(ticks, [spoken(c) for c in classes], rotation=35, ha="right", rotation_mode="anchor")
        axes.set_yticks(ticks, [spoken(c) for c in classes])
        axes.set(xlabel="predicted intention", ylabel="true intention")
        axes.set_title(f"{name}: confusion on unseen seeds")
        axes.grid(visible=False)
        axes.tick_params(length=0)
        bar = drawn.colorbar(image, ax=axes, shrink=0.8, label="share of the true intention's windows")
        bar.outline.set_visible(False)


def loss_curves(history: pd.DataFrame, path: Path, over: str = "") -> None:
    """Draw loss and validation scores against epochs.

    history: the columns of a run's history.csv. over: over which intentions the macro-F1 is, if not all.
    """
    epoch = history["epoch"] + 1
    best = int(history["validation_macro_f1"].to_numpy().argmax())
    with figure(path, 9, 3.6) as drawn:
        left, right = drawn.subplots(1, 2)
        left.plot(epoch, history["train_loss"], label="training")
        left.plot(epoch, history["validation_loss"], label="validation")
        left.set(xlabel="epoch", ylabel="loss", ylim=(0, None))
        left.set_title("Loss")
        right.plot(epoch, history["validation_macro_f1"], color=GREEN, label=f"macro-F1{over}")
        right.plot(epoch, history["validation_accuracy"], color=PURPLE, label="accuracy", alpha=0.8)
        score = history["validation_macro_f1"].iloc[best]
        right.plot(
            epoch[best], score, "o", color=GREEN, mec="white", ms=8, label=f"kept: epoch {epoch[best]}, {score:.3f}"
        )
        right.set(xlabel="epoch", ylabel=SCORE, ylim=(0, 1.02))
        right.set_title("Validation seeds")
        for axes in (left, right):
            axes.xaxis.get_major_locator().set_params(integer=True)
            axes.legend(loc="best")


def unknown_roc(curves: Mapping[str, tuple[Array, Array]], path: Path) -> None:
    """Draw the ROC of separating known intentions from `following`.

    curves: false- and true-positive rates, by the name of the score.
    """
    with figure(path, 5.2, 4.8) as drawn:
        axes = drawn.subplots()
        for name, (false, true) in curves.items():
            axes.plot(false, true, label=name)
        axes.plot([0, 1], [0, 1], ":", color=GREY, lw=1.2, label="chance")
        axes.set(xlabel=FALSE_KNOWN, ylabel=TRUE_KNOWN)
        axes.set(xlim=(0, 1), ylim=(0, 1.01), aspect="equal")
        axes.set_title("The unknown class: following")
        axes.legend(loc="lower right")


def reliability(rows: Mapping[str, Sequence[ReliabilityBin]], path: Path) -> None:
    """Draw how often the TV passes the UV against the probability that was given, a line for each question.

    rows: the bins of probability, by the name of the question.
    """
    with figure(path, 5.2, 4.8) as drawn:
        axes = drawn.subplots()
        axes.plot([0, 1], [0, 1], ":", color=GREY, lw=1.2, label="calibrated")
        for name, bins in rows.items():
            probability, share = [row.mean_probability for row in bins], [row.share_passed for row in bins]
            axes.plot(probability, share, marker="o", ms=4, label=name)
        axes.set(xlabel="probability of passing", ylabel="share that passes", xlim=(0, 1), ylim=(0, 1.01))
        axes.set_aspect("equal")
        axes.set_title("Does the TV pass the UV?")
        axes.legend(loc="lower right")


def lead_time(rows: Mapping[str, Sequence[LeadTimeBin]], path: Path) -> None:
    """Draw macro-F1 against lead time, a line for each predictor, and the number of windows below.

    rows: `by_lead_time` of each predictor, by its name. Bins of fewer than LEAST_WINDOWS windows are left out.
    """
    with figure(path, 8, 4.2) as drawn:
        axes, below = drawn.subplots(2, 1, sharex=True, height_ratios=[4, 1])
        axes.set_prop_cycle(BY_PREDICTOR)
        partly = False
        for name, bins in rows.items():
            kept = [row for row in bins if row.n >= LEAST_WINDOWS and row.macro_f1 is not None]
            partly |= _macro_f1_line(axes, [row.middle_s for row in kept], kept, name)
        bins = next(iter(rows.values()))
        width = bins[0].to_s - bins[0].from_s if bins else 0.2
        below.bar([row.middle_s for row in bins], [row.n for row in bins], 0.9 * width, color="#cbd5e1")
        axes.axvline(0, color=GREY, lw=1, ls="--")
        axes.text(0, 0.04, " commit ", color=GREY, transform=axes.get_xaxis_transform(), ha="left", fontsize=9)
        axes.set(ylabel="macro-F1", ylim=(0, 1.02))
        axes.set_title("Score against lead time" + (HOLLOW if partly else ""))
        axes.legend(**BESIDE)
        below.set(xlabel="lead time: commit minus end of window, s", ylabel="windows")
        # Time runs to the right: windows that end long before the commit come first.
        axes.invert_xaxis()


def window_end(rows: Mapping[str, Sequence[WindowEndScores]], relative_to: str, path: Path) -> None:
    """Draw the window-end curve: macro-F1 against the time at which every window ends, a line for each predictor.

    rows: `by_window_end` of each predictor, by its name. relative_to: onset or commit.
    """
    with figure(path, 8, 3.8) as drawn:
        axes = drawn.subplots()
        axes.set_prop_cycle(BY_PREDICTOR)
        partly = False
        for name, points in rows.items():
            partly |= _macro_f1_line(axes, [point.end_s for point in points], points, name)
        axes.axvline(0, color=GREY, lw=1, ls="--")
        axes.set(xlabel=f"end of window after {relative_to}, s", ylabel="macro-F1", ylim=(0, 1.02))
        axes.set_title("Score against the end of the window" + (HOLLOW if partly else ""))
        axes.legend(**BESIDE)


def _macro_f1_line(axes: Axes, x: Sequence[float], rows: Sequence[LeadTimeBin | WindowEndScores], name: str) -> bool:
    """Draw a predictor's macro-F1 against a quantity, with hollow points where it is not over all intentions.

    x: the quantity at each of the rows. Returns whether there is such a point.
    """
    (line,) = axes.plot(x, [_or_nan(row.macro_f1) for row in rows], marker="o", ms=4, label=name)
    partly = [
        (at, row.macro_f1)
        for at, row in zip(x, rows, strict=True)
        if row.macro_f1 is not None and row.macro_f1_over is not None and len(row.macro_f1_over) < len(KNOWN)
    ]
    for at, score in partly:
        axes.plot(at, score, linestyle="", marker="o", ms=4, color=line.get_color(), mfc="white")
    return bool(partly)


def unknown_lead_time(rows: Mapping[str, Sequence[LeadTimeBin]], path: Path) -> None:
    """Draw the separation of `following` against the lead time of the known windows.

    rows: `by_lead_time` of each predictor, by its name. Bins of fewer than LEAST_WINDOWS windows are left out.
    """
    kept = {name: [row for row in bins if row.n >= LEAST_WINDOWS] for name, bins in rows.items()}
    lines = {name: ([row.middle_s for row in bins], bins) for name, bins in kept.items()}
    with _separation_against(lines, path) as below:
        below.set_xlabel("lead time of the known: commit minus end of window, s")
        # Time runs to the right: windows that end long before the commit come first.
        below.invert_xaxis()


def unknown_window_end(rows: Mapping[str, Sequence[WindowEndScores]], relative_to: str, path: Path) -> None:
    """Draw the separation of `following` against the time at which every window ends.

    rows: `by_window_end` of each predictor, by its name. relative_to: onset or commit.
    """
    lines = {name: ([point.end_s for point in points], points) for name, points in rows.items()}
    with _separation_against(lines, path) as below:
        below.set_xlabel(f"end of window after {relative_to}, s")


@contextmanager
def _separation_against(
    lines: Mapping[str, tuple[Sequence[float], Sequence[LeadTimeBin] | Sequence[WindowEndScores]]], path: Path
) -> Iterator[Axes]:
    """Draw AUROC of `following` above its false-positive rate at 95 % recall, both against one quantity.

    lines: of each predictor, by its name, the quantity and the scores there. Yields the lower axes, for the caller to
    label the x axis.
    """
    with figure(path, 8, 5) as drawn:
        above, below = drawn.subplots(2, 1, sharex=True)
        for axes in (above, below):
            axes.set_prop_cycle(BY_PREDICTOR)
        for name, (x, rows) in lines.items():
            above.plot(x, [_or_nan(row.auroc_unknown) for row in rows], marker="o", ms=4, label=name)
            below.plot(x, [_or_nan(row.fpr_at_95_recall) for row in rows], marker="o", ms=4, label=name)
        for axes in (above, below):
            axes.axvline(0, color=GREY, lw=1, ls="--")
        above.axhline(0.5, color=GREY, lw=1.2, ls=":")
        above.set(ylabel="AUROC", ylim=(0, 1.02))
        above.set_title("Separation of following from the known intentions")
        above.legend(**BESIDE)
        below.set(ylabel="following taken for known\nat 95 % recall", ylim=(0, 1.02))
        yield below


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def despine(axes: Axes) -> None:
    """Remove frame and grid of the axes of a map."""
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)


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
        curves = _roc_curves(evaluated)
        figures.unknown_roc(curves, folder / "unknown_roc.png")
        write_table([*_roc_rows(curves)], folder / "unknown_roc.csv")
    if (curve := result.windows.window_end_curve) is not None:
        by_end = {shown.name: shown.by_window_end or [] for shown in side_by_side}
        figures.window_end(by_end, curve.relative_to, folder / "window_end.png")
        if has_following:
            figures.unknown_window_end(by_end, curve.relative_to, folder / "unknown_window_end.png")
    trained = {f"within {part.within_s:g} s": part.trained for part in result.passing or ()}
    if reliable := {name: answer.reliability for name, answer in trained.items() if answer is not None}:
        figures.reliability(reliable, folder / "passing.png")
    if (run.path / HISTORY_FILE).exists():
        over = over_text(run.card.validated, run.card.classes)
        history = read_history(run.path / HISTORY_FILE)
        figures.loss_curves(history, folder / "loss.png", over)
        write_table([*_history_rows(history, over)], folder / "loss.csv")


def _history_rows(history: pd.DataFrame, over: str) -> Iterator[Row]:
    """Yield a row for each epoch and each of its quantities, each with the name of its line."""
    lines = {
        "training": ("loss", "train_loss"),
        "validation": ("loss", "validation_loss"),
        f"macro-F1{over}": (SCORE, "validation_macro_f1"),
        "accuracy": (SCORE, "validation_accuracy"),
    }
    for name, (panel, column) in lines.items():
        for epoch, value in zip(history["epoch"].tolist(), history[column].tolist(), strict=True):
            yield {"of": name, "epoch": epoch + 1, "loss": None, SCORE: None, panel: value}


def _roc_rows(curves: Mapping[str, tuple[Array, Array]]) -> Iterator[Row]:
    for name, rates in curves.items():
        for false, true in zip(*(rate.tolist() for rate in rates), strict=True):
            yield {"score": name, FALSE_KNOWN: false, TRUE_KNOWN: true}


def read_history(path: Path) -> pd.DataFrame:
    """Return a run's history, a row for each epoch. Raises InputError where it is damaged."""
    try:
        return pd.read_csv(path, dtype=float).astype({"epoch": int})[HISTORY_COLUMNS]
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is damaged ({error}); delete it to evaluate without it") from None


def _roc_curves(measured: MeasuredRun) -> dict[str, tuple[Array, Array]]:
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
