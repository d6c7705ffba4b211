"""The report of an evaluation: a table for the terminal, and one page with everything in it."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from isacsim.errors import InputError
from isacsim.files import replace_file
from labeling.intentions import Intention
from models.data.windows import Ends, Records, cut, fitting
from models.evaluation.evaluation import METRICS_FILE
from models.evaluation.predictions import unseen
from models.report import html_page
from models.report.figures import spoken
from models.report.record_view import RecordView, draw_record
from models.run import Run

if TYPE_CHECKING:
    from labeling.dataset.dataset import Dataset

PAGE = "index.html"
SHOWN = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.OVERTAKE, Intention.EVASIVE_SWERVE)
"""Intentions worth drawing from above, the first that the unseen seeds hold."""
SAID_STEP_S = 0.05

FIGURES = {
    "record.png": "One record of an unseen seed: the target vehicle as the sites sensed it, over the truth.",
    "confusion.png": "Where the windows of each intention went.",
    "lead_time.png": "Score against the time left until the maneuver commits.",
    "window_end.png": "Score against the time at which every window ends.",
    "unknown_lead_time.png": "Telling following apart, against the time left until the maneuver commits.",
    "unknown_window_end.png": "Telling following apart, against the time at which every window ends.",
    "unknown_roc.png": "Telling the intentions that were trained apart from following, which was not.",
    "loss.png": "Training.",
}


def write_report(run: Run, dataset: Dataset, folder: str | Path) -> Path:
    """Add the record figure and index.html to the folder of an evaluation. Returns the page's path."""
    out = Path(folder)
    if not (out / METRICS_FILE).exists():
        raise InputError(f"{out}: holds no {METRICS_FILE}; run `cosim evaluate` first")
    found = json.loads((out / METRICS_FILE).read_text())
    records, truth = Records.of(dataset), dataset.arrays("tv_truth")["tv_truth"]
    row = _worth_drawing(unseen(records, [run]), records)
    scenario = str(records.table["scenario"].iloc[row])
    view = record_view(run, records, truth[row], row)
    draw_record(view, dataset.roads(scenario), dataset.sites(scenario), out / "record.png")
    return write_page(found, out)


def write_page(found: dict[str, Any], out: Path) -> Path:
    """index.html from metrics and the figures in a folder; it needs no other file."""
    file = out / PAGE
    replace_file(file, lambda path: path.write_text(_page(found, out), encoding="utf-8"))
    return file


def table(found: dict[str, Any]) -> Table:
    """Per-intention F1 of the run and of what it is compared with, for the terminal."""
    drawn = Table(title=f"F1 on {found['n']} windows of unseen seeds", title_justify="left")
    drawn.add_column("intention")
    for name in _names(found):
        drawn.add_column(name, justify="right")
    for other in found["compared"]:
        drawn.add_column(f"{found['name']} - {other['name']} (95 %)", justify="right")
    for k, row in enumerate(_rows(found)):
        drawn.add_row(*row, end_section=k == len(found["classes"]) - 1)
    return drawn


def verdict(found: dict[str, Any]) -> list[str]:
    """One line for each compared predictor: which of the two is ahead, and whether the interval leaves a doubt.

    Where runs differ in the training seed alone, also one for each group of such runs.
    """
    lines = []
    for other in found["compared"]:
        each = other["paired_difference"]["macro_f1"]
        ahead, behind = (found["name"], other["name"]) if each["difference"] >= 0 else (other["name"], found["name"])
        sure = "" if each["low"] > 0 or each["high"] < 0 else ", which the interval does not tell from 0"
        lines.append(f"{ahead} is ahead of {behind} by {abs(each['difference']):.3f} macro-F1{sure}.")
    groups = found.get("over_training_seeds", [])
    for group in groups:
        score = group["macro_f1"]
        over = f"{score['mean']:.3f}" + ("" if score["sd"] is None else f", standard deviation {score['sd']:.3f}")
        ahead = group.get("paired_difference", {}).get("macro_f1")
        less = "" if ahead is None else f"; {groups[0]['name']} minus it {_difference(ahead)}"
        lines.append(f"{group['name']}, {score['n']} training seed(s): macro-F1 {over}{less}.")
    return lines


def record_view(run: Run, records: Records, truth: Any, row: int) -> RecordView:
    """What is drawn of one record, with the run's answers to every window in it; truth: (6, S)."""
    table = records.table.iloc[row]
    onset = float(table["t_onset"] - table["t_start"])
    n_tv, n_uv = records.tv.shape[2], records.uv.shape[2]
    first, last = fitting(records, run.card.settings.windows)
    steps = np.arange(first, last + 1, max(1, round(SAID_STEP_S * records.uv_rate_hz)))
    windows = cut(records, Ends(np.full(len(steps), row), steps), run.card.settings.windows)
    snr = float(table["snr_db"])
    note = f", {snr:.1f} dB a site and antenna element" if np.isfinite(snr) else ""
    return RecordView(
        title=f"{spoken(Intention(int(table['label'])).text).capitalize()}: {table['sample_id']}{note}",
        tv=records.tv[row], truth=truth, uv=records.uv[row],
        t_tv=np.arange(n_tv) / records.tv_rate_hz - onset, t_uv=np.arange(n_uv) / records.uv_rate_hz - onset,
        commit_s=float(table["t_commit"] - table["t_onset"]), classes=run.card.classes,
        t_said=steps / records.uv_rate_hz - onset, said=run.predictor(windows).probabilities,
    )  # fmt: skip


def _worth_drawing(left: Records, records: Records) -> int:
    """Row, among all records, of the first unseen record of the first of SHOWN that there is; else the first unseen."""
    ids = left.table["sample_id"]
    for intention in SHOWN:
        if (left.label == intention).any():
            ids = ids[left.label == intention]
            break
    return int(np.flatnonzero(records.table["sample_id"] == ids.iloc[0])[0])


def _names(found: dict[str, Any]) -> list[str]:
    return [found["name"], *(each["name"] for each in found["compared"])]


def _rows(found: dict[str, Any]) -> list[list[str]]:
    """Cells: a row an intention, then macro-F1, accuracy and AUROC of the unknown class."""
    everyone = [found, *found["compared"]]
    pairs = [each["paired_difference"] for each in found["compared"]]
    rows = [
        [
            spoken(name),
            *(_cell(each["per_class_f1"][name]) for each in everyone),
            *(_difference(p["per_class_f1"][name]) for p in pairs),
        ]
        for name in found["classes"]
    ]
    rows.append(
        ["macro-F1", *(_cell(each["macro_f1"]) for each in everyone), *(_difference(p["macro_f1"]) for p in pairs)]
    )
    blank = [""] * len(pairs)
    rows.append(["accuracy", *(_cell(each["accuracy"]) for each in everyone), *blank])
    told = [each["overtake_against_left"] for each in everyone]
    cells = [f"{_cell(each['accuracy'])} ({_cell(each['auroc'])})" for each in told]
    rows.append(["overtake or left, of the two (AUROC)", *cells, *blank])
    if found["auroc_unknown"] is not None:
        rows.append(["AUROC of following", *(_cell(each["auroc_unknown"]) for each in everyone), *blank])
    return rows


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _difference(each: dict[str, float | None]) -> str:
    if each["difference"] is None:
        return "-"
    return f"{each['difference']:+.3f} ({each['low']:+.3f} to {each['high']:+.3f})"


def _page(found: dict[str, Any], out: Path) -> str:
    head = ["intention", *_names(found), *(f"{found['name']} - {each['name']} (95 %)" for each in found["compared"])]
    rows = [[html.escape(cell) for cell in row] for row in _rows(found)]
    shown = "".join(html_page.image(out / name, text) for name, text in FIGURES.items() if (out / name).exists())
    said = "".join(f"<p class=verdict>{html.escape(line)}</p>" for line in verdict(found))
    windows = found["windows"]
    figures = (("macro-F1", "macro_f1"), ("accuracy", "accuracy"), ("AUROC of following", "auroc_unknown"))
    big = "".join(_big(name, found[key]) for name, key in figures)
    early, late = windows["end_after_s"]
    body = f"""<p>{found["n"]} windows of {windows["window_s"]:g} s from scenario seeds that were neither trained nor
chosen on ({html.escape(", ".join(found["made_by"]["seeds"]))}).
Each window ends {early:g} to {late:g} s after {windows["relative_to"]}.</p>
<div class=big>{big}</div>
<h2>F1 of each intention</h2>
{html_page.table([html.escape(h) for h in head], rows, range(len(found["classes"]), len(rows)))}
{said}
<p>Differences are paired on the same windows; the interval is a bootstrap over scenario seeds.</p>
{shown}
{html_page.made_by(json.dumps(found["made_by"], indent=1))}"""
    return html_page.document(f"{found['name']} on unseen traffic", body)


def _big(name: str, value: float | None) -> str:
    return f"<div><b>{_cell(value)}</b>{html.escape(name)}</div>"
