"""What commands show to people, on standard error, and the JSON object that `--json` asks for, on standard output."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isacsim.errors import InputError

if TYPE_CHECKING:
    from isacsim.network import Made
    from labeling.dataset import Dataset
    from labeling.log import Note
    from labeling.study import DatasetStudy


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
    from labeling.summary import faults, show, summary

    found = summary(dataset)
    show(found, console)
    for fault in faults(found):
        print(f"warning: {fault}", file=sys.stderr)
    return found


def show_estimate(study: DatasetStudy, jobs: int, console: Console) -> dict[str, Any]:
    """What a study would take. Returns it as plain values."""
    from labeling.estimate import estimate

    found = estimate(study)
    seconds = found.cpu_s / min(jobs, found.episodes)
    console.print(f"1 cell: about {found.episodes} episodes, {found.samples} samples, {found.bytes / 1e6:.0f} MB")
    console.print(
        f"about {found.cpu_s / 60:.0f} minutes of processor time, {seconds / 60:.0f} minutes on {jobs} workers"
    )
    console.print("by what the bundled motorway takes; training and evaluation come on top", soft_wrap=True)
    return {"cells": 1, **dataclasses.asdict(found), "jobs": jobs, "seconds": round(seconds, 1)}


def show_scenario(made: Made, source: str, console: Console) -> dict[str, Any]:
    """What a scenario was made of. Returns it as plain values."""
    if made.overridden:
        tell_of(console)(source, made.overridden)
    demand = "demand was made" if made.made_demand else "its own demand"
    console.print(f"{made.folder}: {made.sites} sites along {made.edges} edges; {demand}", soft_wrap=True)
    return {**dataclasses.asdict(made), "folder": str(made.folder)}


def show_metrics(found: dict[str, Any], console: Console) -> None:
    """What an evaluation found."""
    from models import report

    console.print(report.table(found))
    for line in report.verdict(found):
        console.print(line, soft_wrap=True)
