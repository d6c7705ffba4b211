"""Table 1 of the CaSTFormer paper: precision and recall apart, in both readings of a missed maneuver."""

from __future__ import annotations

from collections.abc import Sequence

from isac_cosim.evaluation.on_windows.maneuvers import false_predictions, maneuver_statistic
from isac_cosim.evaluation.report.parts import Cell, Part
from isac_cosim.evaluation.statistics import pooled, score
from isac_cosim.studies.reproduction.castformer.measured import MeasuredVariant
from isac_cosim.studies.reproduction.experiments.paper_figures import HORIZONS_S, end_of

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
            true = pooled(counts).sum(axis=1)
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
    return Part("table1", "Table 1: precision and recall", text, list(rows))
