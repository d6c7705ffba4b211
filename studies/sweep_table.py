"""The table of a sweep: its rows, its files, its look on a terminal, and the page with its figure."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich import box
from rich.table import Table

from isac_cosim.base.files import replace_file, write_json
from isac_cosim.evaluation.on_windows.metrics import spread
from isac_cosim.evaluation.on_windows.results import (
    ComparedResult,
    EvaluationResult,
    PredictorResult,
    RunResult,
    ScoreName,
)
from isac_cosim.evaluation.on_windows.score_results import Difference, PairedDifference
from isac_cosim.evaluation.report import page as html_page
from isac_cosim.evaluation.report.figures import CYCLE, figure
from isac_cosim.evaluation.report.report import PAGE
from isac_cosim.studies.sweep_axes import Cell
from isac_cosim.studies.sweep_results import SweepResult, SweepRow, TrainingScores

TABLE_JSON, TABLE_CSV, REPORT, FIGURE = "table.json", "table.csv", "report", "macro_f1.png"
HEADINGS: dict[ScoreName, str] = {
    "before_commit_macro_f1": "macro-F1 before commit", "macro_f1": "macro-F1, all windows", "accuracy": "accuracy",
    "auroc_unknown": "AUROC of following",
}  # fmt: skip
"""The scores that have a mean and a standard deviation over the training seeds."""
AHEAD = "over trees before commit (95 %)"
ON_TERMINAL: tuple[ScoreName, ...] = ("before_commit_macro_f1", "macro_f1", "accuracy")


DRAWN: ScoreName = "before_commit_macro_f1"
"""The score in the figure."""


def row_of(cell: Cell, tested_on: str, result: EvaluationResult, report: str) -> SweepRow:
    """Return a row of the table.

    tested_on: network whose test seeds were measured. result: of the cell's runs, compared with those of the floor.
    report: folder of that evaluation.
    """
    runs = [run for run in result.runs if run.model == cell.model]
    early, macro_f1, accuracy, auroc = (spread([run.score(name) for run in runs]) for name in HEADINGS)
    floor = _compared_floor(result) if len(runs) < len(result.runs) else None
    ahead = _macro_f1(floor.paired_difference if floor else None)
    early_ahead = _macro_f1(floor.paired_difference_before_commit if floor else None)
    return SweepRow(
        network=cell.network,
        sensor=cell.sensing.sensor,
        snr=cell.sensing.snr,
        model=cell.model,
        tested_on=tested_on,
        trainings=len(runs),
        test_seeds=result.groups,
        windows=result.n,
        before_commit_windows=None if result.before_commit is None else result.before_commit.n,
        before_commit_macro_f1=early.mean,
        before_commit_macro_f1_sd=early.sd,
        macro_f1=macro_f1.mean,
        macro_f1_sd=macro_f1.sd,
        accuracy=accuracy.mean,
        accuracy_sd=accuracy.sd,
        auroc_unknown=auroc.mean,
        auroc_unknown_sd=auroc.sd,
        before_commit_ahead_of_floor=early_ahead.difference,
        before_commit_low=early_ahead.low,
        before_commit_high=early_ahead.high,
        ahead_of_floor=ahead.difference,
        low=ahead.low,
        high=ahead.high,
        report=report,
        runs=[_training_scores(card.settings.seed, run) for card, run in zip(result.made_by.runs, runs, strict=False)],
    )


def write_sweep(result: SweepResult, out: Path) -> None:
    """Write table.csv and table.json, and the report folder with the figure and the page."""
    report = out / REPORT
    report.mkdir(exist_ok=True)
    content = result.model_dump(mode="json")
    rows = pd.DataFrame([{name: value for name, value in row.items() if name != "runs"} for row in content["cells"]])
    replace_file(out / TABLE_CSV, lambda path: rows.to_csv(path, index=False))
    write_json(out / TABLE_JSON, content)
    if result.cells:
        draw(result.cells, report / FIGURE)
    replace_file(report / PAGE, lambda path: path.write_text(_page(result, report), encoding="utf-8"))


def table(result: SweepResult) -> Table:
    """Return the table for the terminal."""
    title = "Unseen seeds: mean and standard deviation over training seeds"
    drawn = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    names = _names(result.cells)
    for name in names:
        drawn.add_column(name, no_wrap=True)
    for score_name in ON_TERMINAL:
        drawn.add_column(HEADINGS[score_name], no_wrap=True, justify="right")
    drawn.add_column(AHEAD, justify="right")
    for row in result.cells:
        drawn.add_row(*_labels(row, names), *(_score(row, score_name) for score_name in ON_TERMINAL), _ahead(row))
    return drawn


def draw(rows: Sequence[SweepRow], path: Path) -> None:
    """Draw mean and deviation of every cell's score DRAWN: a line for each way of sensing, a colour for each model."""
    names = [name for name in _names(rows) if name != "model"]
    models = list(dict.fromkeys(row.model for row in rows))
    places = list(dict.fromkeys(", ".join(_labels(row, names)) for row in rows))
    with figure(path, 8, 1.4 + 0.4 * len(places)) as drawn:
        axes = drawn.subplots()
        for k, model in enumerate(models):
            # Predictors on one line stand a little apart.
            offset = 0.5 * ((k + 0.5) / len(models) - 0.5)
            of_model = [row for row in rows if row.model == model]
            scores = [(*row.score(DRAWN), row) for row in of_model]
            points = [(mean, deviation, row) for mean, deviation, row in scores if mean is not None]
            axes.errorbar(
                [mean for mean, _, _ in points],
                [places.index(", ".join(_labels(row, names))) + offset for _, _, row in points],
                xerr=[deviation or 0.0 for _, deviation, _ in points],
                fmt="o", ms=5, capsize=3, color=CYCLE[k % len(CYCLE)], label=model,
            )  # fmt: skip
        axes.set_yticks(range(len(places)), places)
        axes.set(xlabel="macro-F1 before the commit, on unseen seeds", ylim=(len(places) - 0.5, -0.5))
        drawn.legend(loc="outside upper right", ncols=len(models))


def _compared_floor(result: EvaluationResult) -> PredictorResult | ComparedResult:
    """Return the comparison with the floor: of mean scores over training seeds, or of two single runs."""
    if result.over_training_seeds is not None:
        return result.over_training_seeds[-1]
    return result.compared[-1]


def _macro_f1(paired: PairedDifference | None) -> Difference:
    """Return the difference in macro-F1, without bounds where a single test seed gives none."""
    if paired is None:
        return Difference(difference=None, low=None, high=None)
    if not paired.has_interval:
        return Difference(difference=paired.macro_f1.difference, low=None, high=None)
    return paired.macro_f1


def _training_scores(seed: int, run: RunResult) -> TrainingScores:
    return TrainingScores(
        training_seed=seed,
        before_commit_macro_f1=run.before_commit_macro_f1,
        macro_f1=run.macro_f1,
        accuracy=run.accuracy,
        auroc_unknown=run.auroc_unknown,
    )


def _names(rows: Sequence[SweepRow]) -> list[str]:
    """Return the headings of what identifies a row; `tested on` only where that is not always the network itself."""
    crossed = any(row.tested_on != row.network for row in rows)
    return ["network", *(["tested on"] if crossed else []), "sensed by", "model"]


def _labels(row: SweepRow, names: Sequence[str]) -> list[str]:
    """Return what identifies a row, a cell for each of the headings of `_names`."""
    texts = {
        "network": row.network, "tested on": row.tested_on, "sensed by": str(row.sensing), "model": row.model,
    }  # fmt: skip
    return [texts[name] for name in names]


def _score(row: SweepRow, name: ScoreName) -> str:
    mean, deviation = row.score(name)
    if mean is None:
        return "-"
    return f"{mean:.3f}" if deviation is None else f"{mean:.3f} ±{deviation:.3f}"


def _ahead(row: SweepRow) -> str:
    if row.before_commit_ahead_of_floor is None:
        return "-"
    bounds = row.before_commit_low, row.before_commit_high
    interval = "" if None in bounds else f" ({bounds[0]:+.3f} to {bounds[1]:+.3f})"
    return f"{row.before_commit_ahead_of_floor:+.3f}{interval}"


def _count(number: int | None) -> str:
    return "-" if number is None else str(number)


def _page(result: SweepResult, report: Path) -> str:
    """Return the page as HTML; report: its folder."""
    rows, names = result.cells, _names(result.cells)
    head = [*names, "trainings", "test seeds", "windows", "before commit", *HEADINGS.values(), AHEAD, ""]
    lines = [
        [
            *(html.escape(text) for text in _labels(row, names)),
            *map(_count, (row.trainings, row.test_seeds, row.windows, row.before_commit_windows)),
            *(_score(row, name) for name in HEADINGS), _ahead(row),
            f'<a href="../{html.escape(row.report)}/{PAGE}">report</a>',
        ]
        for row in rows
    ]  # fmt: skip
    body = f"""<p>Measured on scenario seeds that were used neither for training nor for any choice, the same in all
cells of a network. Scores are means over training seeds, ± their standard deviation. Windows that end before the
maneuver commits are predicted, the others only recognised. The difference to the macro-F1 of the trees is paired on the
same windows before the commit; its interval is a t interval of the delete-one jackknife over the test seeds.</p>
{html_page.table(head, lines)}
"""
    if rows:
        body += html_page.image(
            report / FIGURE, "Macro-F1 before the commit by cell; whiskers: standard deviation over training seeds."
        )
    if result.failed:
        reasons = "".join(
            f"<li>{html.escape(f'{failed.cell}, training seed {failed.training_seed}: {failed.reason}')}</li>"
            for failed in result.failed
        )
        body += f"<h2>Left out</h2><ul>{reasons}</ul>"
    body += html_page.made_by(json.dumps(result.made_by.model_dump(mode="json"), indent=1))
    return html_page.document(f"Sweep {result.study}", body)
