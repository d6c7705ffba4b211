"""What commands show to people, on standard error, and the JSON object that `--json` asks for, on standard output."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from command_line.progress import ConsoleFeedback, print_line
from isacsim.errors import InputError

if TYPE_CHECKING:
    from isacsim.scenarios.making import Made
    from labeling.dataset.dataset import Dataset
    from models.evaluation.results import EvaluationResult
    from models.studies.study import Study
    from models.studies.sweep_results import SweepResult


UNBOUND = 1000
"""Wider than any table, characters."""


def console_of(quiet: bool) -> Console:
    """Where people's output goes: standard error, or nowhere."""
    return Console(stderr=True, quiet=quiet)


def print_json(as_json: bool, result: dict[str, Any]) -> None:
    """The result of a command as one line of JSON, where that is asked for."""
    if as_json:
        print(json.dumps(result))


def feedback_of(console: Console, verbose: bool = False) -> ConsoleFeedback:
    """Return where long work reports its progress. Raises InputError where details go to a quiet console."""
    if verbose and console.quiet:
        raise InputError("--quiet and --verbose contradict each other; give one of them")
    return ConsoleFeedback(console, verbose)


def show_dataset(dataset: Dataset, console: Console) -> dict[str, Any]:
    """What is in a dataset, and what is amiss with it. Returns its summary."""
    from labeling.dataset.summary import faults, show, summary

    found = summary(dataset)
    show(found, console)
    for fault in faults(found):
        print(f"warning: {fault}", file=sys.stderr)
    return found


def show_estimate(study: Study, jobs: int, console: Console) -> dict[str, Any]:
    """What a study would take. Returns it as plain values."""
    from models.studies.cost_estimate import estimate_study
    from models.training.progress import spoken_time

    found = estimate_study(study)
    counts = f"{_number(found.cells, 'cell')}, {_number(found.trainings, 'training')}, "
    counts += _number(found.datasets, "dataset")
    anew = f", {found.sensed_anew} sensed anew" if found.sensed_anew else ""
    print_line(
        console, f"{counts}: about {found.episodes} episodes, {found.samples} samples{anew}; {_size(found.bytes)}"
    )
    print_line(
        console,
        f"about {spoken_time(found.cpu_s)} of processor time for datasets and {spoken_time(found.training_s)} for "
        f"trainings: {spoken_time(found.seconds(jobs))} with {_number(jobs, 'worker')}",
    )
    print_line(console, "by what the bundled motorway and the networks' defaults take, all epochs counted")
    return {**dataclasses.asdict(found), "jobs": jobs, "seconds": found.seconds(jobs)}


def show_sweep(result: SweepResult, folder: Path, console: Console) -> dict[str, Any]:
    """The table of a sweep, and where it stands. Returns what `--json` gives."""
    from models.report import report
    from models.studies import sweep_table

    # Whole, also where the terminal is narrower or there is none.
    own, console.width = console.width, UNBOUND
    console.print(sweep_table.table(result))
    console.width = own
    page = folder / sweep_table.REPORT / report.PAGE
    print_line(console, f"table: {folder / sweep_table.TABLE_CSV}; page: {page}")
    paths = {"table": str(folder / sweep_table.TABLE_JSON), "report": str(page.parent)}
    return {**paths, **result.model_dump(mode="json", include={"trainings", "cells", "failed"})}


def failures(found: dict[str, Any]) -> str:
    """One line on what a sweep left out."""
    first = found["failed"][0]
    return (
        f"{len(found['failed'])} of {found['trainings']} trainings failed and are left out, the first of "
        f"{first['cell']}, training seed {first['training_seed']}: {first['reason']}; the same command tries them again"
    )


def _number(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _size(number: int) -> str:
    return f"{number / 1e6:.0f} MB" if number < 2e9 else f"{number / 1e9:.1f} GB"


def show_scenario(made: Made, source: str, console: Console) -> dict[str, Any]:
    """What a scenario was made of. Returns it as plain values."""
    from labeling.generation.log import overridden

    if made.overridden:
        print_line(console, overridden(source, made.overridden))
    demand = "demand was made" if made.made_demand else "its own demand"
    console.print(f"{made.folder}: {made.sites} sites along {made.edges} edges; {demand}", soft_wrap=True)
    return {**dataclasses.asdict(made), "folder": str(made.folder)}


def show_metrics(result: EvaluationResult, console: Console) -> None:
    """What an evaluation found."""
    from models.report import report

    console.print(report.table(result))
    for line in report.verdict(result):
        console.print(line, soft_wrap=True)
