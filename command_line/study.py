"""The main job as people see it: a study or a sweep, run behind progress bars and shown."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.feedback import spoken_time
from isac_cosim.base.progress import ConsoleFeedback, print_line
from isac_cosim.base.workers.engine import Engine
from isac_cosim.command_line.output import show_dataset, show_metrics
from isac_cosim.command_line.streams import show_streams
from isac_cosim.studies.study import Study

if TYPE_CHECKING:
    from isac_cosim.studies.sweep_results import SweepResult


def run_and_show(study: Study, folder: Path, engine: Engine, feedback: ConsoleFeedback) -> dict[str, Any]:
    """Run a study, or a sweep of studies, and show what came of it. Returns what `--json` prints."""
    if study.streams:
        return _run_live(study, folder, engine, feedback)
    if study.sweep is None:
        return _run_single(study, folder, engine, feedback)

    from isac_cosim.studies.sweep import run_sweep

    return show_sweep(run_sweep(study, folder, engine, feedback), folder, feedback.console)


def _run_single(study: Study, folder: Path, engine: Engine, feedback: ConsoleFeedback) -> dict[str, Any]:
    from isac_cosim.studies.single import run_study

    metrics = run_study(study, folder, engine, feedback)
    from isac_cosim.evaluation.report.page import PAGE
    from isac_cosim.evaluation.report.score_table import headline_scores
    from isac_cosim.labeling.dataset.dataset import Dataset

    show_dataset(Dataset.open(folder / "dataset"), feedback.console)
    show_metrics(metrics, folder / "report" / PAGE, feedback.console)
    return {
        "dataset": str(folder / "dataset"),
        "run": str(folder / "run"),
        "report": str(folder / "report"),
        "before_commit": headline_scores(metrics),
        "floor_before_commit": headline_scores(metrics.compared[0]),
        "accuracy": metrics.accuracy,
        "macro_f1": metrics.macro_f1,
        "macro_f1_over": metrics.macro_f1_over,
        "floor_macro_f1": metrics.compared[0].macro_f1,
    }


def _run_live(study: Study, folder: Path, engine: Engine, feedback: ConsoleFeedback) -> dict[str, Any]:
    from isac_cosim.evaluation.report.replay.in_traffic import replay_in_traffic
    from isac_cosim.evaluation.report.report import show_live
    from isac_cosim.labeling.streams.dataset import Streams
    from isac_cosim.studies.live import LIVE, STREAMS, run_live_study

    evaluation = run_live_study(study, folder, engine, feedback)
    show_streams(Streams.open(folder / STREAMS), feedback.console)
    replay = replay_in_traffic(evaluation, engine, feedback, folder=folder / LIVE)
    show_live(evaluation.result, folder / LIVE, feedback.console, replay)
    print_line(feedback.console, f"page, figures and metrics.json: {folder / LIVE}")
    return {
        "streams": str(folder / STREAMS),
        "run": str(folder / "run"),
        "report": str(folder / LIVE),
        **evaluation.result.model_dump(mode="json", include={"prediction", "recognition", "stress"}),
        "real_time_factor": evaluation.real_time_factor,
    }


def show_sweep(result: SweepResult, folder: Path, console: Console) -> dict[str, Any]:
    """Show the table of a sweep, complete also where the terminal is narrow. Returns what `--json` prints."""
    from isac_cosim.evaluation.report import terminal
    from isac_cosim.evaluation.report.page import PAGE
    from isac_cosim.studies import sweep_table

    terminal.show(sweep_table.parts(result), console, sweep_table.TITLE, whole=True)
    page = folder / sweep_table.REPORT / PAGE
    print_line(console, f"table: {folder / sweep_table.TABLE_CSV}; page: {page}")
    return {
        "table": str(folder / sweep_table.TABLE_JSON),
        "report": str(page.parent),
        **result.model_dump(mode="json", include={"trainings", "cells", "failed"}),
    }


def show_cost(study: Study, jobs: int, console: Console) -> dict[str, Any]:
    """Show what a study would take. Returns what `--json` prints."""
    if study.streams:
        return _show_live_cost(study, jobs, console)

    from isac_cosim.studies.cost_estimate import estimate_study

    cost = estimate_study(study)
    counts = ", ".join(
        _number(number, what)
        for number, what in ((cost.cells, "cell"), (cost.trainings, "training"), (cost.datasets, "dataset"))
    )
    resensed = f", {cost.sensed_anew} sensed again" if cost.sensed_anew else ""
    print_line(
        console, f"{counts}: about {cost.episodes} episodes, {cost.samples} samples{resensed}; {_size(cost.bytes)}"
    )
    print_line(
        console,
        f"about {spoken_time(cost.cpu_s)} of processor time for datasets and {spoken_time(cost.training_s)} for "
        f"training: {spoken_time(cost.seconds(jobs))} with {_number(jobs, 'worker')}",
    )
    print_line(console, "estimated from the bundled motorway and the networks' default sizes, with no early stopping")
    return {**dataclasses.asdict(cost), "jobs": jobs, "seconds": cost.seconds(jobs)}


def _show_live_cost(study: Study, jobs: int, console: Console) -> dict[str, Any]:
    from isac_cosim.studies.live import estimate_live

    cost = estimate_live(study)
    if cost is None:
        print_line(console, "recordings have a length of their own: what they cost is not known before")
        return {"jobs": jobs}
    print_line(
        console,
        f"{cost.episodes} episodes of streams, about {cost.vehicle_hours:.0f} vehicle-hours, {_size(cost.bytes)}; "
        f"evaluated live on {cost.evaluated_hours:.0f} more",
    )
    print_line(
        console,
        f"about {spoken_time(cost.cpu_s)} of processor time, {spoken_time(cost.cpu_s / jobs)} with "
        f"{_number(jobs, 'worker')}; training comes on top of that, minutes for trees",
    )
    print_line(console, "estimated from the bundled motorway")
    return {**dataclasses.asdict(cost), "jobs": jobs}


def _number(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _size(number: int) -> str:
    return f"{number / 1e6:.0f} MB" if number < 2e9 else f"{number / 1e9:.1f} GB"
