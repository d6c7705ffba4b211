"""The report of an evaluation: a table and sentences for the terminal, and one HTML page with everything in it."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from isacsim.arrays import Array
from isacsim.files import replace_file
from labeling.intentions import Intention
from models.data.windows import Ends, Records, cut, fitting
from models.evaluation.evaluation import Evaluation
from models.evaluation.results import ComparedResult, EvaluationResult, Interval, PairedDifference, PredictorResult
from models.report import html_page
from models.report.evaluation_figures import draw_figures
from models.report.figures import spoken
from models.report.record_choice import choose_record
from models.report.record_view import RecordView, draw_record
from models.run import Run

if TYPE_CHECKING:
    from labeling.dataset.dataset import Dataset

PAGE = "index.html"
RECORD_FIGURE = "record.png"
END_STEP_S = 0.05
"""Time between the ends of the windows that are predicted in a drawn record, s."""

CAPTIONS = {
    RECORD_FIGURE: "One record of an unseen seed: the target vehicle as the sites sensed it, with its true motion.",
    "confusion.png": "Predicted intentions of the windows of each true intention.",
    "lead_time.png": "Score against the time left until the maneuver commits.",
    "window_end.png": "Score against the time at which every window ends.",
    "unknown_lead_time.png": "Separation of following, against the time left until the maneuver commits.",
    "unknown_window_end.png": "Separation of following, against the time at which every window ends.",
    "unknown_roc.png": "Separation of the intentions seen in training from following, which was not.",
    "loss.png": "Training.",
}
"""Figures of a page, in order, with their captions; those that the folder does not hold are left out."""


def write_report(evaluation: Evaluation, dataset: Dataset, folder: str | Path) -> Path:
    """Draw all figures of an evaluation into its folder, with that of one record, and write index.html.

    dataset: the one that was measured. Returns the page's path.
    """
    out, evaluated = Path(folder), evaluation.measured[0]
    draw_figures(evaluation, out)
    choice = choose_record(evaluated.predictions)
    records, truth = Records.of(dataset), dataset.arrays("tv_truth")["tv_truth"]
    row = int(np.flatnonzero(records.table["sample_id"] == choice.sample_id)[0])
    scenario = str(records.table["scenario"].iloc[row])
    view = record_view(evaluated.run, records, truth[row], row)
    draw_record(view, dataset.roads(scenario), dataset.sites(scenario), out / RECORD_FIGURE)
    return write_page(evaluation.result, out, choice.rule)


def write_page(result: EvaluationResult, folder: Path, record_rule: str = "") -> Path:
    """Write index.html from a result and the figures in a folder. The page needs no other file.

    record_rule: sentence for the caption of the record's figure, saying how the record was chosen.
    Returns the page's path.
    """
    page = folder / PAGE
    replace_file(page, lambda path: path.write_text(_page(result, folder, record_rule), encoding="utf-8"))
    return page


def table(result: EvaluationResult) -> Table:
    """Return the F1 of each intention, of the run and of those it is compared with, for the terminal."""
    drawn = Table(title=f"F1 on {result.n} windows of unseen seeds", title_justify="left")
    first, *others = _head(result)
    drawn.add_column(first)
    for heading in others:
        drawn.add_column(heading, justify="right")
    for k, row in enumerate(_rows(result)):
        drawn.add_row(*row, end_section=k == len(result.classes) - 1)
    return drawn


def verdict(result: EvaluationResult) -> list[str]:
    """Return one sentence for each compared run: which of the two is ahead, and whether that could be chance.

    Where runs differ in the training seed alone, also one for each group of such runs.
    """
    groups = result.over_training_seeds or []
    return [
        *(_comparison(result.name, other) for other in result.compared),
        *(_group_sentence(groups[0].name, group) for group in groups),
    ]


def record_view(run: Run, records: Records, truth: Array, row: int) -> RecordView:
    """Return what is drawn of one record, with the run's predictions for every window in it.

    truth: true states of the TV, (6, S). row: of the record.
    """
    table = records.table.iloc[row]
    onset = float(table["t_onset"] - table["t_start"])
    n_tv, n_uv = records.tv.shape[2], records.uv.shape[2]
    first, last = fitting(records, run.card.settings.windows)
    steps = np.arange(first, last + 1, max(1, round(END_STEP_S * records.uv_rate_hz)))
    windows = cut(records, Ends(np.full(len(steps), row), steps), run.card.settings.windows)
    snr_db = float(table["snr_db"])
    snr_note = f", {snr_db:.1f} dB per site and antenna element" if np.isfinite(snr_db) else ""
    return RecordView(
        title=f"{spoken(Intention(int(table['label'])).text).capitalize()}: {table['sample_id']}{snr_note}",
        tv=records.tv[row],
        truth=truth,
        uv=records.uv[row],
        t_tv=np.arange(n_tv) / records.tv_rate_hz - onset,
        t_uv=np.arange(n_uv) / records.uv_rate_hz - onset,
        commit_s=float(table["t_commit"] - table["t_onset"]),
        classes=run.card.classes,
        t_end=steps / records.uv_rate_hz - onset,
        probabilities=run.predictor(windows).probabilities,
    )


def _comparison(name: str, other: ComparedResult) -> str:
    """Return which of two runs is ahead; name: of the evaluated one."""
    paired = other.paired_difference
    gap = paired.macro_f1
    if gap.difference is None or gap.low is None or gap.high is None:
        return f"{name} and {other.name} cannot be compared: macro-F1 is undefined."
    if not paired.has_interval:
        return (
            f"{name} and {other.name} differ by {abs(gap.difference):.3f} macro-F1, "
            "but with a single test seed nothing can be said about the difference."
        )
    ahead, behind = (name, other.name) if gap.difference >= 0 else (other.name, name)
    doubt = "" if gap.low > 0 or gap.high < 0 else ", but the interval includes 0"
    return f"{ahead} is ahead of {behind} by {abs(gap.difference):.3f} macro-F1{doubt}."


def _group_sentence(first_name: str, group: PredictorResult) -> str:
    """Return mean and spread of a predictor over its training seeds; first_name: of the first predictor."""
    score = group.macro_f1
    mean = _cell(score.mean) + ("" if score.sd is None else f", standard deviation {score.sd:.3f}")
    paired = group.paired_difference
    difference = "" if paired is None else f"; {first_name} minus it {_difference(paired, paired.macro_f1)}"
    return f"{group.name}, {score.n} training seed(s): macro-F1 {mean}{difference}."


def _head(result: EvaluationResult) -> list[str]:
    """Return the headings of the columns of `_rows`."""
    names = [run.name for run in result.runs]
    return ["intention", *names, *(f"{result.name} - {name} (95 %)" for name in names[1:])]


def _rows(result: EvaluationResult) -> list[list[str]]:
    """Return cells: a row for each intention, then macro-F1, accuracy, the hard pair, and AUROC of the unknown."""
    runs, pairs = result.runs, [other.paired_difference for other in result.compared]
    blank = [""] * len(pairs)
    rows = [
        [
            spoken(name),
            *(_cell(run.per_class_f1[name]) for run in runs),
            *(_difference(paired, paired.per_class_f1[name]) for paired in pairs),
        ]
        for name in result.classes
    ]
    differences = [_difference(paired, paired.macro_f1) for paired in pairs]
    rows.append(["macro-F1", *(_cell(run.macro_f1) for run in runs), *differences])
    rows.append(["accuracy", *(_cell(run.accuracy) for run in runs), *blank])
    scores = [run.overtake_against_left for run in runs]
    cells = [f"{_cell(score.accuracy)} ({_cell(score.auroc)})" for score in scores]
    rows.append(["overtake or left change (AUROC)", *cells, *blank])
    if result.auroc_unknown is not None:
        rows.append(["AUROC of following", *(_cell(run.auroc_unknown) for run in runs), *blank])
    return rows


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _difference(paired: PairedDifference, interval: Interval) -> str:
    """Return a difference with its interval; interval: one of those in `paired`."""
    if interval.difference is None:
        return "-"
    if not paired.has_interval:
        return f"{interval.difference:+.3f} (no interval)"
    return f"{interval.difference:+.3f} ({interval.low:+.3f} to {interval.high:+.3f})"


def _page(result: EvaluationResult, folder: Path, record_rule: str) -> str:
    """Return the page as HTML."""
    captions = {**CAPTIONS, RECORD_FIGURE: f"{CAPTIONS[RECORD_FIGURE]} {record_rule}".strip()}
    figures = "".join(
        html_page.image(folder / name, caption) for name, caption in captions.items() if (folder / name).exists()
    )
    windows, made_by = result.windows, result.made_by
    early, late = windows.end_after_s
    body = f"""<p>{result.n} windows of {windows.window_s:g} s from scenario seeds that were used neither for training
nor for any choice ({html.escape(", ".join(made_by.seeds))}).
Each window ends {early:g} to {late:g} s after {windows.relative_to}.</p>
<div class=big>{_big("macro-F1", result.macro_f1)}{_big("accuracy", result.accuracy)}\
{_big("AUROC of following", result.auroc_unknown)}</div>
<h2>F1 of each intention</h2>
{_html_table(result)}
{_html_verdict(result)}
{figures}
{html_page.made_by(json.dumps(made_by.model_dump(mode="json"), indent=1))}"""
    return html_page.document(f"{result.name} on unseen traffic", body)


def _html_table(result: EvaluationResult) -> str:
    head = [html.escape(cell) for cell in _head(result)]
    rows = [[html.escape(cell) for cell in row] for row in _rows(result)]
    return html_page.table(head, rows, range(len(result.classes), len(rows)))


def _html_verdict(result: EvaluationResult) -> str:
    """Return the sentences of the verdict and how differences come about; nothing where nothing is compared."""
    if not result.compared:
        return ""
    sentences = "".join(f"<p class=verdict>{html.escape(sentence)}</p>" for sentence in verdict(result))
    explanation = "Differences are paired on the same windows"
    if result.compared[0].paired_difference.has_interval:
        explanation += "; the interval is a bootstrap over scenario seeds"
    return f"{sentences}\n<p>{explanation}.</p>"


def _big(name: str, value: float | None) -> str:
    return f"<div><b>{_cell(value)}</b>{html.escape(name)}</div>"
