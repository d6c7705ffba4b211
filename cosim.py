"""The command line: parse, call, print.

The packages are imported inside the commands, so that help and usage errors answer at once.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isacsim.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from labeling.dataset import Dataset
    from labeling.study import DatasetStudy

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="From a SUMO road network to an evaluated driver-intention predictor that sees traffic through ISAC sensing.",
)
INTERRUPTED = 130
KEPT = "interrupted; what was finished is kept, the same command goes on from there"
SEEDS_WITH_WINDOWS = (1, 1000)
"""The seeds that --windows may use up where no --seeds bound them."""

Out = Annotated[Path, typer.Option("-o", "--out", help="Folder to write; a new or empty one, or one to go on with.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Worker processes; the number of cores when absent.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output, last.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Only warnings and errors on standard error.")]


@app.command()
def run(
    study: Annotated[Path | None, typer.Argument(help="Study file (.toml); the bundled quick one when absent.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder to write; results/<study> when absent.")
    ] = None,
    jobs: Jobs = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """The main job: generate, train, evaluate, report."""
    from labeling.engine import LocalEngine
    from labeling.generate import generate as generate_dataset
    from models import report
    from models.main_job import run_study
    from models.study import read_study

    began = time.monotonic()
    console, content = _console(quiet), read_study(study)
    folder = out or Path("results") / content.name

    def make(where: Path) -> Dataset:
        with _bar(console, content.dataset) as progress:
            made = generate_dataset(content.dataset, where, LocalEngine(jobs or _cores()), progress)
        _show_dataset(made, console)
        return made

    found = run_study(content, folder, make, console)
    _show_metrics(found, console)
    console.print(f"figures and report: {folder / 'report' / report.PAGE}", soft_wrap=True)
    if as_json:
        result = {
            "dataset": str(folder / "dataset"),
            "run": str(folder / "run"),
            "report": str(folder / "report"),
            "accuracy": found["accuracy"],
            "macro_f1": found["macro_f1"],
            "floor_macro_f1": found["compared"][0]["macro_f1"],
            "seconds": round(time.monotonic() - began, 1),
        }
        print(json.dumps(result))


@app.command()
def generate(
    scenarios: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help="Bundled name, folder, .sumocfg or .net.xml.")
    ],
    out: Out,
    windows: Annotated[
        int | None, typer.Option(min=1, help="Samples to reach; every seed is used when absent.")
    ] = None,
    seeds: Annotated[str | None, typer.Option(metavar="A:B", help="Traffic seeds, both ends included.")] = None,
    snr: Annotated[
        str | None, typer.Option(metavar="LO:HI", help="Per-element SNR, dB, drawn uniformly in this range.")
    ] = None,
    jobs: Jobs = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A labelled dataset; resumes where it stopped."""
    from labeling.engine import LocalEngine
    from labeling.generate import generate as generate_dataset
    from labeling.summary import summary

    study, console = _dataset_study(scenarios, windows, seeds, snr), _console(quiet)
    with _bar(console, study) as progress:
        made = generate_dataset(study, out, LocalEngine(jobs or _cores()), progress)
    _show_dataset(made, console)
    if as_json:
        print(json.dumps(summary(made)))


@app.command()
def inspect(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    verify: Annotated[bool, typer.Option("--verify", help="Reread every shard against its digest.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """What is in a dataset: counts by intention and origin, rates, seeds, SNR."""
    from labeling.dataset import Dataset
    from labeling.summary import summary

    opened = Dataset.open(dataset)
    if verify:
        opened.verify()
    _show_dataset(opened, _console(quiet))
    if as_json:
        print(json.dumps({**summary(opened), "verified": verify}))


@app.command()
def train(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    out: Out,
    model: Annotated[str, typer.Option(help="The predictor: asi-bip or trees.")] = "asi-bip",
    epochs: Annotated[int | None, typer.Option(min=1, help="Epochs at most.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of initial weights, window ends and batches.")] = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A trained predictor; resumes where it stopped."""
    from labeling.dataset import Dataset
    from labeling.study import checked
    from models.run import TrainSettings
    from models.training import train as train_predictor

    optimiser = {} if epochs is None else {"epochs": epochs}
    settings = checked(TrainSettings, {"model": model, "seed": seed, "optimiser": optimiser}, "arguments")
    console = _console(quiet)
    made = train_predictor(Dataset.open(dataset), out, settings, console)
    card = made.card
    if card.validation_macro_f1 is not None:
        console.print(f"best epoch {card.best_epoch}, validation macro-F1 {card.validation_macro_f1:.3f}")
    if as_json:
        result = {"run": str(out), "best_epoch": card.best_epoch, "validation_macro_f1": card.validation_macro_f1}
        print(json.dumps(result))


@app.command()
def evaluate(
    run: Annotated[Path, typer.Argument(help="Folder of a trained predictor.")],
    data: Annotated[Path, typer.Option("--data", metavar="DATASET", help="Dataset whose unseen seeds are used.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder to write; RUN/evaluation when absent.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Metrics and figures of a predictor on windows of traffic it has not seen."""
    from labeling.dataset import Dataset
    from models import report
    from models.evaluation import evaluate as evaluate_run
    from models.run import load_run

    console, loaded, dataset = _console(quiet), load_run(run), Dataset.open(data)
    folder = out or run / "evaluation"
    found = evaluate_run(loaded, dataset, folder)
    page = report.write_report(loaded, dataset, folder)
    _show_metrics(found, console)
    console.print(f"figures and report: {page}", soft_wrap=True)
    if as_json:
        print(json.dumps({"report": str(folder), **found}))


def main(arguments: Sequence[str] | None = None) -> int:
    """The console script. Returns the exit code: 0 done, 1 failed, 2 wrong input, 130 interrupted.

    What went wrong goes to standard error, in one line where the user can mend it.
    """
    usage_error: Any = typer.BadParameter.__base__
    try:
        code = int(app(arguments, standalone_mode=False) or 0)
    except InputError as error:
        return _complain(str(error), 2)
    except usage_error as error:
        return _complain(f"{error.format_message()} Try `cosim --help`.", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except Exception:
        traceback.print_exc()
        return 1
    # Newer typers turn Ctrl-C into this code themselves.
    return _complain(KEPT, code) if code == INTERRUPTED else code


def _complain(message: str, code: int) -> int:
    print(f"cosim: {' '.join(message.split())}", file=sys.stderr)
    return code


def _dataset_study(scenarios: list[str], windows: int | None, seeds: str | None, snr: str | None) -> DatasetStudy:
    """The study that generate's arguments describe."""
    from labeling.study import DatasetStudy, checked

    content: dict[str, Any] = {"scenarios": scenarios, "selection": {"windows": windows}}
    if seeds is not None or windows is not None:
        first, last = _pair(seeds, "--seeds", int, "1:20") if seeds else SEEDS_WITH_WINDOWS
        content["seeds"] = {"first": first, "last": last}
    if snr is not None:
        channel = {"kind": "uniform", "snr_range_db": _pair(snr, "--snr", float, "0:10")}
        content["sensing"] = {"channel": channel}
    return checked(DatasetStudy, content, "arguments")


def _pair(text: str, option: str, kind: Callable[[str], Any], example: str) -> tuple[Any, Any]:
    """Both ends of a range A:B, A at most B. Raises InputError where it is none."""
    try:
        low, high = (kind(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"{option} {text}: is no range; write it like {example}") from None
    if not low <= high:
        raise InputError(f"{option} {text}: is no range, its first end is above its second; write it like {example}")
    return low, high


@contextmanager
def _bar(console: Console, study: DatasetStudy) -> Iterator[Callable[[int, int], None]]:
    """A progress bar with the time left; yields what moves it: done, of how much."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("generating"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("samples" if study.selection.windows else "episodes"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    progress = Progress(*columns, console=console, speed_estimate_period=300)
    task = progress.add_task("", total=None)

    def move(done: int, total: int) -> None:
        # Drawn from the first move on: what is refused before any work begins shows no bar.
        progress.start()
        progress.update(task, completed=done, total=total)

    try:
        yield move
    finally:
        if progress.live.is_started:
            progress.stop()


def _show_dataset(dataset: Dataset, console: Console) -> None:
    """What is in a dataset, for people, and what went wrong in making it."""
    from rich.table import Table

    from labeling.summary import summary

    found = summary(dataset)
    table = Table("intention", *found["by_origin"], "samples")
    for name, number in found["by_intention"].items():
        table.add_row(name, *map(str, found["by_intention_and_origin"][name].values()), str(number))
    table.add_section()
    table.add_row("all", *map(str, found["by_origin"].values()), str(found["samples"]))
    console.print(f"{dataset.path}, digest {found['digest'][:12]}", highlight=False, soft_wrap=True)
    console.print(table)
    for key in ("seeds", "snr_db", "n_sites", "position_error_m", "left_out", "collided", "teleported"):
        console.print(f"{key}: {_brief(found[key])}", highlight=False, soft_wrap=True)
    for lost in found["lost"]:
        _warn(f"episode {lost['scenario']}-{lost['seed']} was left out: {lost['reason']}")
    if found["short"]:
        _warn(f"the seeds ended before the study's least number was reached of: {', '.join(found['short'])}")


def _show_metrics(found: dict[str, Any], console: Console) -> None:
    """What an evaluation found, for people."""
    from models import report

    console.print(report.table(found))
    for line in report.verdict(found):
        console.print(line, soft_wrap=True)


def _brief(value: Any) -> str:
    """Plain values for a person's eye: runs of seeds as ranges."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_brief(each)}" for key, each in value.items())
    if isinstance(value, list):
        return f"{value[0]} to {value[-1]} ({len(value)})" if value else "none"
    return str(value)


def _warn(message: str) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _console(quiet: bool) -> Console:
    """Where people's output goes: standard error, or nowhere."""
    from rich.console import Console

    return Console(stderr=True, quiet=quiet)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


if __name__ == "__main__":
    sys.exit(main())
