"""The report of an evaluation: one HTML page with everything in it."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.files import replace_file
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.on_windows.evaluation import Evaluation
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report import page as html_page
from isac_cosim.evaluation.report.figures import draw_figures, spoken
from isac_cosim.evaluation.report.passing_table import QUESTION, passing_table
from isac_cosim.evaluation.report.record_view import RecordView, choose_record, draw_record
from isac_cosim.evaluation.report.score_table import by_lead_table, head, headline, sections
from isac_cosim.evaluation.report.verdict import headline_difference, seeds_text, verdict
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Ends, Records, cut, fitting
from isac_cosim.models.runs.run import Run

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

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
    "passing.png": "How often the TV passes the UV, against the probability of trees trained on this question.",
    "loss.png": "Training.",
}
"""Figures of a page, in order, with their captions; those that the folder does not hold are left out."""


@limited()
def write_report(evaluation: Evaluation, dataset: Dataset, folder: str | Path) -> Path:
    """Draw all figures of an evaluation into its folder, with that of one record, and write index.html.

    dataset: the one that was measured. Returns the page's path.
    """
    out, evaluated = Path(folder), evaluation.measured[0]
    draw_figures(evaluation, out)
    choice = choose_record(evaluated.predictions)
    sample_ids = dataset.frame(["sample_id"])["sample_id"]
    row = int(np.flatnonzero(sample_ids == choice.sample_id)[0])
    records, truth = Records.of(dataset), dataset.record("tv_truth", row)
    scenario = str(records.table["scenario"].iloc[row])
    view = record_view(evaluated.run, records, truth.astype(np.float64), row)
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
        tv=np.asarray(records.tv[row], np.float64),
        truth=truth,
        uv=np.asarray(records.uv[row], np.float64),
        t_tv=np.arange(n_tv) / records.tv_rate_hz - onset,
        t_uv=np.arange(n_uv) / records.uv_rate_hz - onset,
        commit_s=float(table["t_commit"] - table["t_onset"]),
        classes=run.card.classes,
        t_end=steps / records.uv_rate_hz - onset,
        probabilities=run.answer(windows).probabilities,
    )


def _page(result: EvaluationResult, folder: Path, record_rule: str) -> str:
    """Return the page as HTML."""
    captions = {**CAPTIONS, RECORD_FIGURE: f"{CAPTIONS[RECORD_FIGURE]} {record_rule}".strip()}
    figures = "".join(
        html_page.image(folder / name, caption) for name, caption in captions.items() if (folder / name).exists()
    )
    windows, made_by = result.windows, result.made_by
    early, late = windows.end_after_s
    body = f"""<p>{result.n} windows of {windows.window_s:g} s from {seeds_text(len(made_by.seeds))}, used neither for
training nor for any choice ({html.escape(", ".join(made_by.seeds))}).
Each window ends {early:g} to {late:g} s after {windows.relative_to}. To classify a window that ends before the maneuver
commits is prediction; one that ends after it, recognition.</p>
<div class=big>{"".join(_big(name, value) for value, name in headline(result))}</div>
{_html_sections(result)}
{_html_by_lead(result)}
{_html_verdict(result)}
{_html_passing(result)}
{figures}
{html_page.made_by(json.dumps(made_by.model_dump(mode="json"), indent=1))}"""
    return html_page.document(f"{result.name} on unseen traffic", body)


def _html_sections(result: EvaluationResult) -> str:
    """Return the table of scores, a part with a title for each section."""
    top = [html.escape(text) for text in head(result)]
    parts = []
    for section in sections(result):
        rows = [[html.escape(text) for text in row] for row in section.rows]
        parts.append(f"<h2>{html.escape(section.title)}</h2>\n{html_page.table(top, rows, section.strong)}")
    return "\n".join(parts)


def _html_by_lead(result: EvaluationResult) -> str:
    """Return the scores of the evaluated run by lead time and intention; nothing where they were not measured."""
    if result.before_commit is None or not result.before_commit.by_lead:
        return ""
    top, rows = by_lead_table(result.before_commit, result.classes)
    cells = [[html.escape(text) for text in row] for row in rows]
    title = f"{result.name}: windows that end so long before the commit, and not before the onset"
    strong = range(len(result.classes), len(rows))
    return f"<h2>{html.escape(title)}</h2>\n{html_page.table([html.escape(text) for text in top], cells, strong)}"


def _html_passing(result: EvaluationResult) -> str:
    """Return how well it is answered whether the TV passes the UV soon; nothing where that was not asked."""
    if not result.passing:
        return ""
    top, rows = passing_table(result.passing)
    cells = [[html.escape(text) for text in row] for row in rows]
    text = (
        "Every pull-out behind a UV is asked, whether it is an overtake, a lane change or in no class. A run answers "
        "with its probability of an overtake, as a share of that of an overtake or a change to the faster side; the "
        "trees learn the question itself, from the training seeds, and are calibrated on the validation seeds."
    )
    table = html_page.table([html.escape(cell) for cell in top], cells, range(len(result.runs) + 1))
    return f"<h2>{html.escape(QUESTION)}</h2>\n<p>{text}</p>\n{table}"


def _html_verdict(result: EvaluationResult) -> str:
    """Return the sentences of the verdict, and how differences come about where runs are compared."""
    sentences = "".join(f"<p class=verdict>{html.escape(sentence)}</p>" for sentence in verdict(result))
    if not result.compared:
        return sentences
    explanation = "Differences are paired on the same windows"
    paired = headline_difference(result.compared[0])
    if paired is not None and paired.has_interval:
        explanation += (
            "; intervals are 95 % t intervals of the delete-one jackknife over the test seeds, and do not cover what "
            "another training would change"
        )
    return f"{sentences}\n<p>{explanation}.</p>"


def _big(name: str, value: str) -> str:
    return f"<div><b>{html.escape(value)}</b>{html.escape(name)}</div>"
