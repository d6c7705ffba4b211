"""The table of a sweep: its rows, its files, its look on a terminal, and the page with its figure."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich import box
from rich.table import Table

from isacsim.files import replace_file, write_json
from models.evaluation.metrics import spread
from models.evaluation.results import EvaluationResult, PairedDifference, RunResult, ScoreName
from models.report import html_page
from models.report.figures import CYCLE, figure
from models.report.report import PAGE
from models.studies.sweep_axes import Cell
from models.studies.sweep_results import SweepResult, SweepRow, TrainingScores

TABLE_JSON, TABLE_CSV, REPORT, FIGURE = "table.json", "table.csv", "report", "macro_f1.png"
HEADINGS: dict[ScoreName, str] = {
    "macro_f1": "macro-F1", "accuracy": "accuracy", "auroc_unknown": "AUROC of following",
}  # fmt: skip
"""The scores that have a mean and a standard deviation over the training seeds."""
AHEAD = "over trees (95 %)"
ON_TERMINAL: tuple[ScoreName, ...] = ("macro_f1", "accuracy")


def row_of(cell: Cell, tested_on: str, result: EvaluationResult, report: str) -> SweepRow:
    """Return a row of the table.

    tested_on: network whose test seeds were measured. result: of the cell's runs, compared with those of the floor.
    report: folder of that evaluation.
    """
    runs = [run for run in result.runs if run.model == cell.model]
    macro_f1, accuracy, auroc = (spread([run.score(name) for run in runs]) for name in HEADINGS)
    difference = _difference_to_floor(result) if len(runs) < len(result.runs) else None
    bounds = difference.macro_f1 if difference is not None and difference.has_interval else None
    return SweepRow(
        network=cell.network,
        sensor=cell.sensing.sensor,
        snr=cell.sensing.snr,
        model=cell.model,
        tested_on=tested_on,
        trainings=len(runs),
        windows=result.n,
        macro_f1=macro_f1.mean,
        macro_f1_sd=macro_f1.sd,
        accuracy=accuracy.mean,
        accuracy_sd=accuracy.sd,
        auroc_unknown=auroc.mean,
        auroc_unknown_sd=auroc.sd,
        ahead_of_floor=None if difference is None else difference.macro_f1.difference,
        low=None if bounds is None else bounds.low,
        high=None if bounds is None else bounds.high,
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
    """Draw mean and standard deviation of every cell's macro-F1: a line for each way of sensing, a colour a model."""
    names = [name for name in _names(rows) if name != "model"]
    models = list(dict.fromkeys(row.model for row in rows))
    places = list(dict.fromkeys(", ".join(_labels(row, names)) for row in rows))
    with figure(path, 8, 1.4 + 0.4 * len(places)) as drawn:
        axes = drawn.subplots()
        for k, model in enumerate(models):
            # Predictors on one line stand a little apart.
            offset = 0.5 * ((k + 0.5) / len(models) - 0.5)
            of_model = [row for row in rows if row.model == model]
            points = [(row.macro_f1, row.macro_f1_sd, row) for row in of_model if row.macro_f1 is not None]
            axes.errorbar(
                [mean for mean, _, _ in points],
                [places.index(", ".join(_labels(row, names))) + offset for _, _, row in points],
                xerr=[deviation or 0.0 for _, deviation, _ in points],
                fmt="o", ms=5, capsize=3, color=CYCLE[k % len(CYCLE)], label=model,
            )  # fmt: skip
        axes.set_yticks(range(len(places)), places)
        axes.set(xlabel="macro-F1 on unseen seeds", ylim=(len(places) - 0.5, -0.5))
        drawn.legend(loc="outside upper right", ncols=len(models))


def _difference_to_floor(result: EvaluationResult) -> PairedDifference | None:
    """Return the difference of mean scores over training seeds, or of two single runs, to the floor."""
    if result.over_training_seeds is not None:
        return result.over_training_seeds[-1].paired_difference
    return result.compared[-1].paired_difference


def _training_scores(seed: int, run: RunResult) -> TrainingScores:
    return TrainingScores(
        training_seed=seed, macro_f1=run.macro_f1, accuracy=run.accuracy, auroc_unknown=run.auroc_unknown
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
    if row.ahead_of_floor is None:
        return "-"
    interval = "" if row.low is None else f" ({row.low:+.3f} to {row.high:+.3f})"
    return f"{row.ahead_of_floor:+.3f}{interval}"


def _page(result: SweepResult, report: Path) -> str:
    """Return the page as HTML; report: its folder."""
    rows, names = result.cells, _names(result.cells)
    head = [*names, "trainings", "windows", *HEADINGS.values(), AHEAD, ""]
    lines = [
        [
            *(html.escape(text) for text in _labels(row, names)),
            str(row.trainings), str(row.windows),
            *(_score(row, name) for name in HEADINGS), _ahead(row),
            f'<a href="../{html.escape(row.report)}/{PAGE}">report</a>',
        ]
        for row in rows
    ]  # fmt: skip
    body = f"""<p>Measured on scenario seeds that were used neither for training nor for any choice, the same in all
cells of a network. Scores are means over training seeds, ± their standard deviation. The difference to the macro-F1 of
the trees is paired on the same windows; its interval is a bootstrap over scenario seeds.</p>
{html_page.table(head, lines)}
"""
    if rows:
        body += html_page.image(report / FIGURE, "Macro-F1 by cell; whiskers: standard deviation over training seeds.")
    if result.failed:
        reasons = "".join(
            f"<li>{html.escape(f'{failed.cell}, training seed {failed.training_seed}: {failed.reason}')}</li>"
            for failed in result.failed
        )
        body += f"<h2>Left out</h2><ul>{reasons}</ul>"
    body += html_page.made_by(json.dumps(result.made_by.model_dump(mode="json"), indent=1))
    return html_page.document(f"Sweep {result.study}", body)
