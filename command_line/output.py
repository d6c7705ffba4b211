"""What commands show to people, on standard error, and the JSON object that `--json` asks for, on standard output."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isacsim.errors import InputError

if TYPE_CHECKING:
    from isacsim.scenarios.making import NewScenario
    from labeling.dataset.dataset import Dataset
    from labeling.generation.log import Note
    from models.studies.study import Study


UNBOUND = 1000
"""Wider than any table, characters."""


def console_of(quiet: bool) -> Console:
    """Where people's output goes: standard error, or nowhere."""
    return Console(stderr=True, quiet=quiet)


def print_json(as_json: bool, result: dict[str, Any]) -> None:
    """The result of a command as one line of JSON, where that is asked for."""
    if as_json:
        print(json.dumps(result))


def note_of(console: Console, verbose: bool) -> Note | None:
    """What tells a person how every episode ended, where that is asked for."""
    if verbose and console.quiet:
        raise InputError("--quiet and --verbose contradict each other; give one of them")
    return (lambda entry: plain(console, str(entry))) if verbose else None


def tell_of(console: Console) -> Callable[[str, Sequence[str]], None]:
    """What tells a person which options of a scenario's configuration are overridden."""

    def tell(scenario: str, options: Sequence[str]) -> None:
        plain(console, f"{scenario}: the time base and outputs are the tool's own; not followed: {', '.join(options)}")

    return tell


def plain(console: Console, line: str) -> None:
    """A line as it is: not wrapped, and without markup."""
    console.print(line, highlight=False, soft_wrap=True, markup=False)


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
    plain(console, f"{counts}: about {found.episodes} episodes, {found.samples} samples{anew}; {_size(found.bytes)}")
    plain(
        console,
        f"about {spoken_time(found.cpu_s)} of processor time for datasets and {spoken_time(found.training_s)} for "
        f"trainings: {spoken_time(found.seconds(jobs))} with {_number(jobs, 'worker')}",
    )
    plain(console, "by what the bundled motorway and the networks' defaults take, all epochs counted")
    return {**dataclasses.asdict(found), "jobs": jobs, "seconds": found.seconds(jobs)}


def show_sweep(found: dict[str, Any], folder: Path, console: Console) -> dict[str, Any]:
    """The table of a sweep, and where it stands. Returns what `--json` gives."""
    from models.report import report
    from models.studies import sweep_table

    # Whole, also where the terminal is narrower or there is none.
    own, console.width = console.width, UNBOUND
    console.print(sweep_table.table(found))
    console.width = own
    page = folder / sweep_table.REPORT / report.PAGE
    plain(console, f"table: {folder / sweep_table.TABLE_CSV}; page: {page}")
    paths = {"table": str(folder / sweep_table.TABLE_JSON), "report": str(page.parent)}
    return {**paths, "trainings": found["trainings"], "cells": found["cells"], "failed": found["failed"]}


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


def show_scenario(made: NewScenario, source: str, console: Console) -> dict[str, Any]:
    """What a scenario was made of. Returns it as plain values."""
    if made.overridden:
        tell_of(console)(source, made.overridden)
    demand = "demand was made" if made.made_demand else "its own demand"
    console.print(f"{made.folder}: {made.sites} sites along {made.edges} edges; {demand}", soft_wrap=True)
    return {**dataclasses.asdict(made), "folder": str(made.folder)}


def show_metrics(found: dict[str, Any], console: Console) -> None:
    """What an evaluation found."""
    from models.report import report

    console.print(report.table(found))
    for line in report.verdict(found):
        console.print(line, soft_wrap=True)
