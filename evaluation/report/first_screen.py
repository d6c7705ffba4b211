"""What is seen first of an evaluation on windows: the road that moves, F1 by intention, and who is taken for whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.parts import Matrix, Part, Row, Shown
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.labeling.intentions import spoken

NATURAL = "natural"


@dataclass(frozen=True)
class MovingRoad:
    """The replay: of the episode of one test record, or of the worst moments in traffic; nothing without one."""

    result_class: type

    def parts(self, shown: Shown) -> list[Part]:
        if shown.replay is None:
            return []
        return [Part("replay", shown.replay.title, replay=shown.replay, on_terminal=False)]


class ByIntention:
    """F1 of each intention before the commit, natural maneuvers apart; nothing where it was not measured."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        before = result.before_commit
        if before is None:
            return []
        natural = before.by_origin.get(NATURAL)
        rows: list[Row] = []
        for name in result.classes:
            scores = before.per_class[name]
            row: Row = {"intention": spoken(name), "F1": Estimate(value=scores.f1), "windows": scores.n}
            if natural is not None:
                of_natural = natural.per_class[name]
                row = {**row, "F1, natural alone": Estimate(value=of_natural.f1), "natural windows": of_natural.n}
            rows.append(row)
        text = "Windows that end before the commit. Natural maneuvers are those of SUMO's drivers alone."
        title = f"F1 of {result.name} by intention"
        return [Part("f1-by-intention", title, text, rows, bars=True, on_terminal=False)]


class ConfusionMatrix:
    """Who is taken for whom before the commit, or on all windows; a cell opens the records behind it."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        before = result.before_commit
        counts = result.confusion if before is None else before.confusion
        which = "all windows" if before is None else "windows that end before the commit"
        opens = " A cell opens the records behind it." if shown.confused else ""
        text = f"Numbers of {which}, rows true and columns predicted.{opens}"
        replayed = {record.id for record in shown.replay.records} if shown.replay is not None else set[str]()
        matrix = Matrix(result.classes, counts, shown.confused, replayed)
        return [Part("confusion", "Which intention is taken for which", text, matrix=matrix, on_terminal=False)]


def confused(predictions: Predictions, result: EvaluationResult) -> Mapping[tuple[int, int], Sequence[str]]:
    """Return the ids of the records behind each cell of the confusion matrix, by its row and column.

    predictions: of the evaluated run.
    """
    counted = predictions.known if result.before_commit is None else predictions.before_commit
    cells: dict[tuple[int, int], dict[str, None]] = {}
    rows = zip(predictions.label[counted], predictions.predicted[counted], predictions.sample_id[counted], strict=True)
    for label, predicted, sample_id in rows:
        cells.setdefault((int(label), int(predicted)), {})[str(sample_id)] = None
    return {cell: [*ids] for cell, ids in sorted(cells.items())}
