"""Tables 1 and 2 and Fig. 4 of the CaSTFormer paper: precision and recall, parameters, confusion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from isac_cosim.evaluation.on_windows.maneuvers import false_predictions, maneuver_statistic
from isac_cosim.evaluation.report import figures
from isac_cosim.evaluation.report.parts import Cell, Part, Row
from isac_cosim.evaluation.statistics import pooled, score
from isac_cosim.labeling.intentions import spoken
from isac_cosim.studies.reproduction.castformer.measured import MeasuredVariant
from isac_cosim.studies.reproduction.castformer.variants import COMPLETE
from isac_cosim.studies.reproduction.experiments.pages import FIGURES
from isac_cosim.studies.reproduction.experiments.paper_figures import (
    HORIZONS_S,
    PRECISION_RECALL,
    STREAMS,
    end_of,
)

SCORES: dict[str, Literal["precision", "recall", "f1"]] = {"precision": "precision", "recall": "recall", "F1": "f1"}
"""Names of the scores in `maneuver_scores`, by their headings."""
ALIKE = (
    'The paper\'s MP, "failing to detect an actual maneuver", has two readings: every miss, also a confusion with '
    "another maneuver; and maneuvers predicted as background only. All other tables count every miss."
)


def maneuvers_part(measured: Sequence[MeasuredVariant]) -> Part | None:
    """Return precision, recall and F1 of the complete network at each horizon, None where nothing was measured."""
    if not measured:
        return None
    network = measured[0]
    background, rows = network.background, list[dict[str, Cell]]()
    for horizon_s in HORIZONS_S:
        counts = network.at(horizon_s)
        row: dict[str, Cell] = {"observation ends": end_of(horizon_s)}
        if background is not None:
            true = pooled(counts[:1]).sum(axis=1)
            row |= {"maneuvers": int(true.sum() - true[background]), "background": int(true[background])}
        row |= {
            "precision": score(maneuver_statistic("precision", background), counts),
            "recall": score(maneuver_statistic("recall", background), counts),
            "F1": score(maneuver_statistic("f1", background), counts),
        }
        if background is not None:
            row |= {
                "recall, background only": score(maneuver_statistic("recall", background, "as_background"), counts),
                "F1, background only": score(maneuver_statistic("f1", background, "as_background"), counts),
                "share of the background taken for a maneuver": score(false_predictions(background), counts),
            }
        rows.append(row)
    if background is None:
        text = (
            "These samples have no background class, so nothing is ever predicted where there is no maneuver (FPP is "
            "0) and none is missed as background. The stage `background` has plain driving as a class."
        )
    else:
        text = ALIKE
    return Part("precision_recall", "Precision and recall by horizon", text, list(rows))


def table_1(measured: Sequence[MeasuredVariant]) -> Part | None:
    """Return the paper's Table 1, with ours in the row of the complete network; None where nothing was measured."""
    if not measured:
        return None
    counts, background = measured[0].at(0), measured[0].background
    rows: list[Row] = []
    for method, printed in PRECISION_RECALL.items():
        row: dict[str, Cell] = {"method": method}
        row |= {f"paper: {name}": _share(value) for name, value in zip(SCORES, printed, strict=True)}
        if method == COMPLETE.title:
            row |= {f"ours: {name}": score(maneuver_statistic(SCORES[name], background), counts) for name in SCORES}
        rows.append(row)
    text = (
        "Ours is CaSTFormer at 0 s, over all folds and trainings. The paper's numbers are of Brain4Cars; the other "
        "methods read video, GPS or maps, which our samples do not have. Our states hold the velocity of both "
        "vehicles, so there is no variant without speed."
    )
    return Part("table1", "Table 1: precision and recall", text, rows)


def table_2(measured: Sequence[MeasuredVariant]) -> Part | None:
    """Return the paper's Table 2, with ours in the row of the complete network; None where nothing was measured."""
    if not measured:
        return None
    counts, background = measured[0].at(0), measured[0].background
    parameters = measured[0].scores[0].parameters
    rows: list[Row] = []
    for method, streams, f1, printed in STREAMS:
        row: dict[str, Cell] = {
            "method": method,
            "streams": streams,
            "paper: F1": _share(f1),
            "paper: parameters, millions": printed,
        }
        if method == COMPLETE.title:
            row["ours: F1"] = score(maneuver_statistic("f1", background), counts)
            row["ours: parameters, millions"] = None if parameters is None else round(parameters / 1e6, 3)
        rows.append(row)
    text = (
        "The paper's parameters are those of the network and of the optical flow. Ours has no feature extraction from "
        "video. One stream alone is of networks on raw video, which have no counterpart here."
    )
    return Part("table2", "Table 2: streams and parameters", text, rows)


def confusion_part(measured: Sequence[MeasuredVariant], names: Sequence[str], out: Path) -> Part | None:
    """Return the confusion of the complete network at 0 s, its figure drawn; names: of the classes."""
    if not measured:
        return None
    counts = pooled(measured[0].at(0))
    figures.confusion(np.array(counts.tolist()), list(names), out / FIGURES / "fig4.png", COMPLETE.title)
    rows: list[Row] = [
        {"true": spoken(name), **{spoken(other): int(n) for other, n in zip(names, row, strict=True)}}
        for name, row in zip(names, counts, strict=True)
    ]
    text = (
        "At 0 s, all folds and trainings together; true classes down, predicted ones across. The paper's figure is of "
        "Brain4Cars."
    )
    return Part("fig4", "Fig. 4: confusion", text, rows, [("fig4.png", "Confusion on the tested folds.")])


def _share(percent: float | None) -> float | None:
    return None if percent is None else round(percent / 100, 4)
