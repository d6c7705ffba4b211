"""The table of a sweep: its rows, its files, its look on a terminal, and the page with its figure."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from rich import box
from rich.table import Table

from isacsim.files import replace_file, write_json
from models.evaluation.metrics import spread
from models.report import html_page
from models.report.figures import CYCLE, figure
from models.report.report import PAGE
from models.studies.sweep_axes import Cell, Sensing

TABLE_JSON, TABLE_CSV, REPORT, FIGURE = "table.json", "table.csv", "report", "macro_f1.png"
SCORES = {"macro_f1": "macro-F1", "accuracy": "accuracy", "auroc_unknown": "AUROC of following"}
"""What has a mean and a standard deviation over the training seeds, and its heading."""
AHEAD = "over trees (95 %)"
ON_TERMINAL = ("macro_f1", "accuracy")
Row = Mapping[str, Any]


def row_of(cell: Cell, tested_on: str, metrics: Row, report: str) -> dict[str, Any]:
    """A row of the table: mean and standard deviation of SCORES over the cell's training seeds.

    tested_on: the network. metrics: of the cell's runs beside the floor's. report: folder of their evaluation.
    `ahead_of_floor` is the paired difference in mean macro-F1; `low` and `high` bound it over several test seeds.
    A standard deviation of one training is None, and so is a score that none has. `runs` holds the trainings.
    """
    everyone = [metrics, *metrics["compared"]]
    own, floors = ([each for each in everyone if (each["model"] == cell.model) is mine] for mine in (True, False))
    row: dict[str, Any] = {
        "network": cell.network, "sensor": cell.sensing.sensor, "snr": cell.sensing.snr, "model": cell.model,
        "tested_on": tested_on, "trainings": len(own), "windows": metrics["n"],
    }  # fmt: skip
    for name in SCORES:
        found = spread([each[name] for each in own])
        row |= {name: found["mean"], f"{name}_sd": found["sd"]}
    row |= {"ahead_of_floor": None, "low": None, "high": None}
    if floors:
        # Of the means over training seeds; of two single runs it stands with the one compared.
        paired = metrics.get("over_training_seeds", metrics["compared"])[-1]["paired_difference"]
        row["ahead_of_floor"] = paired["macro_f1"]["difference"]
        if paired["groups"] > 1:
            row |= {end: paired["macro_f1"][end] for end in ("low", "high")}
    seeds = [each["settings"]["seed"] for each in metrics["made_by"]["runs"]]
    runs = [
        {"training_seed": seed, **{name: each[name] for name in SCORES}} for seed, each in zip(seeds, own, strict=False)
    ]
    return {**row, "report": report, "runs": runs}


def write_sweep(found: dict[str, Any], out: Path) -> None:
    """Write table.csv and table.json, and the report folder with the figure and the page."""
    cells, report = found["cells"], out / REPORT
    report.mkdir(exist_ok=True)
    plain = pd.DataFrame([{name: value for name, value in row.items() if name != "runs"} for row in cells])
    replace_file(out / TABLE_CSV, lambda path: plain.to_csv(path, index=False))
    write_json(out / TABLE_JSON, found)
    if cells:
        draw(cells, report / FIGURE)
    replace_file(report / PAGE, lambda path: path.write_text(_page(found, report), encoding="utf-8"))


def table(found: dict[str, Any]) -> Table:
    """For the terminal."""
    drawn = Table(title="Unseen seeds: mean and spread over training seeds", title_justify="left", box=box.SIMPLE_HEAD)
    names = _names(found["cells"])
    for name in names:
        drawn.add_column(name, no_wrap=True)
    for name in ON_TERMINAL:
        drawn.add_column(SCORES[name], no_wrap=True, justify="right")
    drawn.add_column(AHEAD, justify="right")
    for row in found["cells"]:
        drawn.add_row(*_named(row, names), *(_score(row, name) for name in ON_TERMINAL), _ahead(row))
    return drawn


def draw(cells: Sequence[Row], path: Path) -> None:
    """Macro-F1 of every cell, mean and standard deviation; a line a way of sensing, a colour a predictor."""
    names = [name for name in _names(cells) if name != "model"]
    models = list(dict.fromkeys(row["model"] for row in cells))
    places = list(dict.fromkeys(", ".join(_named(row, names)) for row in cells))
    with figure(path, 8, 1.4 + 0.4 * len(places)) as drawn:
        axes = drawn.subplots()
        for k, model in enumerate(models):
            shown = [row for row in cells if row["model"] == model and row["macro_f1"] is not None]
            # Predictors of one line stand a little apart.
            aside = 0.5 * ((k + 0.5) / len(models) - 0.5)
            axes.errorbar(
                [row["macro_f1"] for row in shown],
                [places.index(", ".join(_named(row, names))) + aside for row in shown],
                xerr=[row["macro_f1_sd"] or 0.0 for row in shown],
                fmt="o", ms=5, capsize=3, color=CYCLE[k % len(CYCLE)], label=model,
            )  # fmt: skip
        axes.set_yticks(range(len(places)), places)
        axes.set(xlabel="macro-F1 on unseen seeds", ylim=(len(places) - 0.5, -0.5))
        drawn.legend(loc="outside upper right", ncols=len(models))


def _names(cells: Sequence[Row]) -> list[str]:
    """Headings of what names a row; `tested on` only where that is not always the network itself."""
    crossed = any(row["tested_on"] != row["network"] for row in cells)
    return ["network", *(["tested on"] if crossed else []), "sensed by", "model"]


def _named(row: Row, names: Sequence[str]) -> list[str]:
    texts = {**row, "tested on": row["tested_on"], "sensed by": str(Sensing(row["sensor"], row["snr"]))}
    return [texts[name] for name in names]


def _score(row: Row, name: str) -> str:
    mean, deviation = row[name], row[f"{name}_sd"]
    if mean is None:
        return "-"
    return f"{mean:.3f}" if deviation is None else f"{mean:.3f} ±{deviation:.3f}"


def _ahead(row: Row) -> str:
    if row["ahead_of_floor"] is None:
        return "-"
    interval = "" if row["low"] is None else f" ({row['low']:+.3f} to {row['high']:+.3f})"
    return f"{row['ahead_of_floor']:+.3f}{interval}"


def _page(found: dict[str, Any], report: Path) -> str:
    cells, names = found["cells"], _names(found["cells"])
    head = [*names, "trainings", "windows", *SCORES.values(), AHEAD, ""]
    lines = [
        [
            *(html.escape(text) for text in _named(row, names)),
            str(row["trainings"]), str(row["windows"]),
            *(_score(row, name) for name in SCORES), _ahead(row),
            f'<a href="../{html.escape(row["report"])}/{PAGE}">report</a>',
        ]
        for row in cells
    ]  # fmt: skip
    body = f"""<p>Measured on scenario seeds that were neither trained nor chosen on, the same in all cells of a
network. Scores are means over training seeds, ± their standard deviation. Macro-F1 over that of the trees is paired on
the same windows; its interval is a bootstrap over scenario seeds.</p>
{html_page.table(head, lines)}
"""
    if cells:
        body += html_page.image(report / FIGURE, "Macro-F1 by cell; whiskers: standard deviation over training seeds.")
    if found["failed"]:
        failed = [
            f"{each['cell']}, training seed {each['training_seed']}: {each['reason']}" for each in found["failed"]
        ]
        body += f"<h2>Left out</h2><ul>{''.join(f'<li>{html.escape(line)}</li>' for line in failed)}</ul>"
    body += html_page.made_by(json.dumps(found["made_by"], indent=1))
    return html_page.document(f"Sweep {found['study']}", body)
