"""What commands show to people, on standard error, and the JSON object that `--json` asks for, on standard output."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.files import json_text
from isac_cosim.base.progress import UNBOUND, ConsoleFeedback, print_line

if TYPE_CHECKING:
    from isac_cosim.evaluation.on_windows.results import EvaluationResult
    from isac_cosim.isacsim.scenarios.making import NewScenario
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.runs.run import Run


def console_of(quiet: bool) -> Console:
    """Return where people's output goes: standard error, or nowhere.

    In a file or a pipe it is wider than any table: a column that is cut off there cannot be looked up anywhere.
    """
    console = Console(stderr=True, quiet=quiet)
    if not console.is_terminal:
        console.width = UNBOUND
    return console


def feedback_of(console: Console, verbose: bool = False) -> ConsoleFeedback:
    """Return where long work reports its progress. Raises InputError where details would go to a quiet console."""
    if verbose and console.quiet:
        raise InputError("--quiet and --verbose contradict each other; give one of them")
    return ConsoleFeedback(console, verbose)


def print_json(as_json: bool, result: dict[str, Any]) -> None:
    """Print the result of a command as one line of JSON, if that was asked for."""
    if as_json:
        print(json_text(result))


def fail_if_incomplete(result: dict[str, Any]) -> None:
    """Raise RunError, in one line, where a sweep left trainings out."""
    if failed := result.get("failed"):
        raise RunError(
            f"{len(failed)} of {result['trainings']} trainings failed and are left out, the first of "
            f"{failed[0]['cell']}, training seed {failed[0]['training_seed']}: {failed[0]['reason']}; "
            "the same command tries them again"
        )


def show_dataset(dataset: Dataset, console: Console) -> dict[str, Any]:
    """Show what is in a dataset, and warn of what is missing. Returns its summary."""
    from isac_cosim.labeling.dataset.summary import faults, show, summary

    content = summary(dataset)
    show(content, console)
    for fault in faults(content):
        warn(fault)
    return content


def warn(line: str) -> None:
    """Print a warning on standard error, also where the console is quiet."""
    print(f"warning: {line}", file=sys.stderr)


def show_scenario(scenario: NewScenario, source: str, console: Console) -> dict[str, Any]:
    """Show what a scenario was made of. Returns it as plain values."""
    from isac_cosim.isacsim.scenarios.sumo_config import read_config
    from isac_cosim.isacsim.traffic.drivers.driver_types import limits_at_thresholds
    from isac_cosim.labeling.detectors.settings import LabelSettings
    from isac_cosim.labeling.generation.log import withheld

    for line in (*withheld(source, scenario), *scenario.remarks):
        print_line(console, line)
    demand = "demand was made" if scenario.made_demand else "its own demand"
    print_line(console, f"{scenario.folder}: {scenario.sites} sites along {scenario.edges} edges; {demand}")
    inputs = read_config(next(scenario.folder.glob("*.sumocfg")))
    drivers = limits_at_thresholds((*inputs.demand, *inputs.additional), LabelSettings().limits_mps2)
    for line in drivers:
        print_line(console, f"warning: {line}")
    if scenario.corners:
        print_line(console, f"warning: {scenario.corners}")
    return {**dataclasses.asdict(scenario), "folder": str(scenario.folder), "drivers": drivers}


def show_run(run: Run, console: Console) -> dict[str, Any]:
    """Show how a training ended. Returns what `--json` prints."""
    from isac_cosim.labeling.intentions import over_text

    card = run.card
    if card.validation_macro_f1 is not None:
        over = over_text(card.validated, card.classes)
        best = f"best epoch {card.best_epoch}, validation macro-F1 {card.validation_macro_f1:.3f}{over}"
        print_line(console, f"{best}, {card.parameters} parameters")
    return {
        "run": str(run.path),
        "best_epoch": card.best_epoch,
        "validation_macro_f1": card.validation_macro_f1,
        "validation_macro_f1_over": card.validated,
    }


def note_former(runs: Sequence[Run], console: Console) -> None:
    """Say once which runs were made by versions that stored no digests of their files."""
    if former := [str(run.path) for run in runs if not run.card.files]:
        print_line(console, f"{', '.join(former)}: of a version that stored no digests; files are checked by content")


def show_metrics(result: EvaluationResult, page: Path, console: Console) -> None:
    """Show what an evaluation measured, and where its page is."""
    from isac_cosim.evaluation.report.report import show

    show(result, page.parent, console)
    print_line(console, f"figures and report: {page}")
