"""The table of a sweep: its rows, its files, its look on a terminal, and the page with its figure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from operator import itemgetter
from pathlib import Path

import pandas as pd

from isac_cosim.base.files import json_text, replace_file, write_json
from isac_cosim.evaluation.on_windows.metrics import spread
from isac_cosim.evaluation.on_windows.results import (
    ComparedResult,
    EvaluationResult,
    PredictorResult,
    RunResult,
    ScoreName,
)
from isac_cosim.evaluation.on_windows.score_results import Difference, PairedDifference
from isac_cosim.evaluation.report.figures import BESIDE, BY_PREDICTOR, CYCLE, figure
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.page import PAGE, write_page
from isac_cosim.evaluation.report.parts import Link, Part, Row, Shown, counted, interval_text
from isac_cosim.evaluation.report.registry import parts_of
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.replay.kept import write_replay
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.labeling.intentions import KNOWN
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
TITLE = "Unseen seeds: mean and standard deviation over training seeds"
TEXT = (
    "Measured on scenario seeds that were used neither for training nor for any choice, the same in all cells of a "
    "network. Scores are means over training seeds, ± their standard deviation. Windows that end before the maneuver "
    "commits are predicted, the others only recognised. A macro-F1 is the mean over all intentions, or over as many as "
    "stand beside it. The difference to the macro-F1 of the trees is paired on the "
    "same windows before the commit; its interval is a t interval of the delete-one jackknife over the test seeds."
)
SNR, SNR_FIGURE = "per-element SNR, dB", "macro_f1_by_snr.png"
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
        before_commit_macro_f1_over=None if result.before_commit is None else len(result.before_commit.macro_f1_over),
        macro_f1=macro_f1.mean,
        macro_f1_sd=macro_f1.sd,
        macro_f1_over=None if result.macro_f1_over is None else len(result.macro_f1_over),
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


def best_of(rows: Sequence[SweepRow]) -> SweepRow | None:
    """Return the row with the highest score DRAWN, None where no row has it."""
    scored = [(score, -k) for k, row in enumerate(rows) if (score := row.score(DRAWN)[0]) is not None]
    return rows[-max(scored)[1]] if scored else None


def is_written(result: SweepResult, out: Path) -> bool:
    """Return whether the table of this very result is there."""
    with suppress(OSError, ValueError):
        return bool(json.loads((out / TABLE_JSON).read_text(encoding="utf-8")) == result.model_dump(mode="json"))
    return False


def write_sweep(result: SweepResult, out: Path, replay: Replay | None = None) -> None:
    """Write table.csv and table.json, and the report folder with the figure, the page, and the replay on it.

    replay: of a test episode of the best cell.
    """
    report = out / REPORT
    report.mkdir(exist_ok=True)
    content = result.model_dump(mode="json")
    rows = pd.DataFrame([{name: value for name, value in row.items() if name != "runs"} for row in content["cells"]])
    replace_file(out / TABLE_CSV, lambda path: rows.to_csv(path, index=False))
    if result.cells:
        draw(result.cells, report / FIGURE)
    if at_snrs := by_snr(result.cells):
        draw_by_snr(at_snrs, report / SNR_FIGURE)
    if replay is not None:
        write_replay(report, replay)
    moving = [] if replay is None else [Part("replay", replay.title, replay=replay, on_terminal=False)]
    shown = [_first(result), *moving, *parts(result), *parts_of(Shown(result, report))]
    origin = json_text(result.made_by.model_dump(mode="json"), 1)
    write_page(f"Sweep {result.study}", shown, origin, report)
    write_json(out / TABLE_JSON, content)  # Last: it marks a finished sweep.


def _first(result: SweepResult) -> Part:
    """Return what was compared, in a sentence, and the best and the worst of it."""
    rows = result.cells
    networks, sensings, models = (
        len({getattr(row, name) for row in rows}) for name in ("tested_on", "sensing", "model")
    )
    text = (
        f"What a network knows of drivers' intentions, compared over {counted(networks, 'road network')}, "
        f"{counted(sensings, 'way')} of sensing and {counted(models, 'predictor')}, on traffic that none of them saw: "
        f"{counted(result.trainings, 'training')}."
    )
    best = best_of(rows)
    if best is None:
        return Part("sweep-first", text=text, on_terminal=False)
    numbers = [_number(best, f"{HEADINGS[DRAWN]}, the best")]
    if best.before_commit_ahead_of_floor is not None:
        numbers.append((_ahead(best), "of that over the trees on the same windows"))
    worst = min((row for row in rows if row.score(DRAWN)[0] is not None), key=lambda row: row.score(DRAWN)[0] or 0.0)
    if worst != best:
        numbers.append(_number(worst, "the worst"))
    return Part("sweep-first", text=text, numbers=numbers, on_terminal=False)


def _number(row: SweepRow, which: str) -> tuple[str, str]:
    """Return a score in large type, and what it is; over how many intentions, where these are not all, stands there."""
    score, over, counts = _score(row, DRAWN).partition(" over ")
    return score, f"{which}: {_spoken(row)}{f'{over}{counts} intentions' if over else ''}"


def _spoken(row: SweepRow) -> str:
    return f"{row.model} on {row.tested_on}, sensed by {row.sensing}"


def parts(result: SweepResult) -> list[Part]:
    """Return what the page and the terminal show."""
    labels = [_labels(row, result.cells) for row in result.cells]
    brief: list[Row] = []
    whole: list[Row] = []
    for label, row in zip(labels, result.cells, strict=True):
        brief.append({**label, **{HEADINGS[name]: _score(row, name) for name in ON_TERMINAL}, AHEAD: _ahead(row)})
        counts = {"trainings": row.trainings, "test seeds": row.test_seeds, "windows": row.windows}
        scores = {heading: _score(row, name) for name, heading in HEADINGS.items()}
        report = Link("report", f"../{row.report}/{PAGE}")
        whole.append(
            {**label, **counts, "before commit": row.before_commit_windows, **scores, AHEAD: _ahead(row), "": report}
        )
    figure = (FIGURE, "Macro-F1 before the commit by cell; whiskers: standard deviation over training seeds.")
    said = "; ".join(f"{_spoken(row)}: {_score(row, DRAWN)}" for row in result.cells)
    seen = {FIGURE: f"A mark for each cell. {said}."}
    at_snrs = by_snr(result.cells)
    curve = Part(
        "by-snr",
        figures=[(SNR_FIGURE, "Macro-F1 before the commit against the SNR at which the sites sense, as means.")],
        figure_rows={SNR_FIGURE: at_snrs},
        seen={SNR_FIGURE: f"A line for each predictor, over {counted(len({row[SNR] for row in at_snrs}), 'SNR')}."},
        charts={SNR_FIGURE: Chart(SNR, (HEADINGS[DRAWN],))},
        on_terminal=False,
    )
    failed = [f"{failed.cell}, training seed {failed.training_seed}: {failed.reason}" for failed in result.failed]
    return [
        Part("cells", rows=brief, on_page=False),
        Part(
            "cells-in-full",
            text=TEXT,
            rows=whole,
            figures=[figure],
            seen=seen,
            on_terminal=False,
        ),
        *([curve] if at_snrs else []),
        *([Part("left-out", "Left out", lines=failed, on_terminal=False)] if failed else []),
    ]


def draw(rows: Sequence[SweepRow], path: Path) -> None:
    """Draw mean and deviation of every cell's score DRAWN: a line for each way of sensing, a colour for each model."""
    models = list(dict.fromkeys(row.model for row in rows))
    places = list(dict.fromkeys(_place(row, rows) for row in rows))
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
                [places.index(_place(row, rows)) + offset for _, _, row in points],
                xerr=[deviation or 0.0 for _, deviation, _ in points],
                fmt="o", ms=5, capsize=3, color=CYCLE[k % len(CYCLE)], label=model,
            )  # fmt: skip
        axes.set_yticks(range(len(places)), places)
        axes.set(xlabel="macro-F1 before the commit, on unseen seeds", ylim=(len(places) - 0.5, -0.5))
        drawn.legend(loc="outside upper right", ncols=len(models))


def by_snr(rows: Sequence[SweepRow]) -> list[Row]:
    """Return the score DRAWN of the cells sensed at one SNR each, by predictor; nothing unless there are several."""
    found: list[tuple[float, Row]] = []
    for row in rows:
        labels = {heading: text for heading, text in _labels(row, rows).items() if heading != "sensed by"}
        if len({other.network for other in rows}) == 1:
            del labels["network"]
        mean, deviation = row.score(DRAWN)
        with suppress(ValueError):
            snr_db = float(row.snr or "")
            name = ", ".join((labels.pop("model"), *labels.values()))
            score = Estimate(value=mean, sd=deviation)
            found.append((snr_db, {"predictor": name, SNR: snr_db, HEADINGS[DRAWN]: score}))
    several = len({snr_db for snr_db, _ in found}) > 1
    return [row for _, row in sorted(found, key=itemgetter(0))] if several else []


def draw_by_snr(rows: Sequence[Row], path: Path) -> None:
    """Draw the rows of `by_snr`, a line for each predictor."""
    curves = Chart(SNR, (HEADINGS[DRAWN],)).content(rows)["lines"]
    with figure(path, 8, 4) as drawn:
        axes = drawn.subplots()
        axes.set_prop_cycle(BY_PREDICTOR)
        for curve in curves:
            axes.plot(curve["x"], curve["y"], marker="o", ms=4, label=curve["name"])
        axes.set(xlabel=SNR, ylabel=HEADINGS[DRAWN], ylim=(0, 1.02))
        axes.legend(**BESIDE)


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


def _labels(row: SweepRow, rows: Sequence[SweepRow]) -> dict[str, str]:
    """Return what identifies a row; `tested on` only where that is not always the network itself."""
    crossed = any(other.tested_on != other.network for other in rows)
    tested_on = {"tested on": row.tested_on} if crossed else {}
    return {"network": row.network, **tested_on, "sensed by": str(row.sensing), "model": row.model}


def _place(row: SweepRow, rows: Sequence[SweepRow]) -> str:
    """Return what identifies a row's line of the figure."""
    return ", ".join(text for heading, text in _labels(row, rows).items() if heading != "model")


def _score(row: SweepRow, name: ScoreName) -> str:
    mean, deviation = row.score(name)
    if mean is None:
        return "-"
    over = row.over(name)
    of_fewer = "" if over is None or over == len(KNOWN) else f" over {over} of {len(KNOWN)}"
    return (f"{mean:.3f}" if deviation is None else f"{mean:.3f} ±{deviation:.3f}") + of_fewer


def _ahead(row: SweepRow) -> str:
    if row.before_commit_ahead_of_floor is None:
        return "-"
    interval = interval_text(row.before_commit_low, row.before_commit_high, sign="+")
    return f"{row.before_commit_ahead_of_floor:+.3f}{interval}"
