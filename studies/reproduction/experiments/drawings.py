"""Figures that only a reproduction has: scores against SNR or horizon, and histograms of confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.report.figures import BESIDE, BLUE, BY_PREDICTOR, GREY, ORANGE, figure

MARKS = "osD^v<>PX*"
"""Marks of the curves of a figure, so that they are told apart without colours."""


def lines(
    curves: Mapping[str, Sequence[float]],
    at: Sequence[float],
    path: Path,
    labels: tuple[str, str, str],
    reference: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Draw scores from 0 to 1 against a quantity.

    curves: a line each, by name; NaN leaves a gap. at: values of the quantity. labels: title, x axis, y axis.
    reference: the paper's lines, dotted in the colours of the lines of the same name.
    """
    with figure(path, 8, 4.2) as drawn:
        axes = drawn.subplots()
        axes.set_prop_cycle(BY_PREDICTOR)
        for mark, (name, values) in zip(cycle(MARKS), curves.items(), strict=False):
            (line,) = axes.plot(at, values, marker=mark, ms=5, label=name)
            if reference and name in reference:
                axes.plot(at, reference[name], ":", color=line.get_color(), lw=1.4, label=f"{name}, paper")
        title, x, y = labels
        axes.set(xlabel=x, ylabel=y, ylim=(0, 1.02))
        axes.set_title(title)
        axes.legend(**BESIDE)


def bars(ours: Mapping[str, tuple[float, float, float]], paper: Mapping[str, float], path: Path) -> None:
    """Draw macro-F1 by way of sensing: the paper's as crosses, ours as points with their intervals.

    ours: value, lower and upper bound of the interval, by name. paper: values, by name.
    """
    names = list(ours)
    with figure(path, 8, 1.2 + 0.45 * len(names)) as drawn:
        axes = drawn.subplots()
        values, low, high = np.array(list(ours.values())).T
        widths = np.stack([values - low, high - values])
        axes.errorbar(values, range(len(names)), xerr=widths, fmt="o", capsize=3, color=BLUE, label="ours, 95 %")
        marked = [(paper[name], k) for k, name in enumerate(names) if name in paper]
        axes.plot([score for score, _ in marked], [k for _, k in marked], "x", color=ORANGE, ms=8, label="paper")
        axes.set_yticks(range(len(names)), names)
        axes.set(xlabel="macro-F1 on unseen seeds", ylim=(len(names) - 0.5, -0.5))
        drawn.legend(loc="outside upper right", ncols=2)


def confidence(known: Array, unknown: Array, threshold: float, path: Path) -> None:
    """Draw how confident a predictor is with known intentions and with `following`.

    known, unknown: number of windows in even bins from 0 to 1, (n,). threshold: below it, a window counts as unknown.
    """
    edges = np.linspace(0, 1, len(known) + 1)
    with figure(path, 7, 3.6) as drawn:
        axes = drawn.subplots()
        for counts, name, colour in ((known, "known", BLUE), (unknown, "following", ORANGE)):
            axes.stairs(counts / max(1, counts.sum()), edges, label=name, color=colour, fill=True, alpha=0.45)
        axes.axvline(threshold, color=GREY, ls="--", label="threshold")
        axes.set(xlabel="largest probability", ylabel="share of the windows", xlim=(0, 1))
        axes.set_title("Confidence")
        axes.legend(loc="upper left")
