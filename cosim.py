"""The command line: parse, call, print.

The packages are imported inside the commands, so that help and usage errors answer at once.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isacsim.errors import NO_ROOM, InputError, RunError, output_error

if TYPE_CHECKING:
    from rich.console import Console

    from isacsim.demand import DemandSettings
    from isacsim.network import Made
    from isacsim.site_placement import PlacementSettings
    from labeling.dataset import Dataset
    from labeling.engine import Engine
    from labeling.log import Note
    from labeling.study import DatasetStudy

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="From a SUMO road network to an evaluated driver-intention predictor that sees traffic through ISAC sensing.",
)
network_app = typer.Typer(no_args_is_help=True, help="Scenarios made from a map, or from a network without sites.")
app.add_typer(network_app, name="network")
INTERRUPTED = 130
KEPT = "interrupted; what was finished is kept, the same command goes on from there"

Out = Annotated[Path, typer.Option("-o", "--out", help="Folder to write; a new or empty one, or one to go on with.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Worker processes; the number of cores when absent.")]
Cluster = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A running dask scheduler, instead of own worker processes.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output, last.")]
SNR_FORMS = "LO:HI|VALUE|link"
Spacing = Annotated[float | None, typer.Option(metavar="M", help="Between poles along the road, m.")]
SetBack = Annotated[float | None, typer.Option(metavar="M", help="Of poles from the road's edge, m.")]
Height = Annotated[float | None, typer.Option(metavar="M", help="Of the antennas above the road, m.")]
Vehicles = Annotated[int | None, typer.Option(help="Vehicles on the road at once, about, where demand is made.")]
DemandSeed = Annotated[int, typer.Option("--seed", help="Seed of the demand that is made.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Only warnings and errors on standard error.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="A line on standard error for every episode.")]


@app.command()
def run(
    study: Annotated[Path | None, typer.Argument(help="Study file (.toml); the bundled quick one when absent.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder to write; results/<study> when absent.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only tell what it would take, about; nothing is written.")
    ] = False,
    jobs: Jobs = None,
    cluster: Cluster = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The main job: generate, train, evaluate, report."""
    from labeling.generate import generate as generate_dataset
    from labeling.progress import bar
    from models import report
    from models.main_job import run_study
    from models.study import read_study

    began = time.monotonic()
    console, content = _console(quiet), read_study(study)
    if dry_run:
        _show_estimate(content.dataset, jobs or _cores(), console, as_json)
        return
    folder = out or Path("results") / content.name

    def make(where: Path) -> Dataset:
        with bar(console, "generating", content.dataset.unit) as progress:
            made = generate_dataset(
                content.dataset,
                where,
                _engine(jobs, cluster),
                progress,
                tell=_tell(console),
                note=_note(console, verbose),
            )
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
        str | None, typer.Option(metavar=SNR_FORMS, help="Per-element SNR, dB: a range to draw from, or a link budget.")
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """A labelled dataset; resumes where it stopped."""
    from labeling.arguments import dataset_study
    from labeling.generate import generate as generate_dataset
    from labeling.progress import bar

    study, console = dataset_study(scenarios, windows, seeds, snr), _console(quiet)
    with bar(console, "generating", study.unit) as progress:
        made = generate_dataset(
            study, out, _engine(jobs, cluster), progress, tell=_tell(console), note=_note(console, verbose)
        )
    found = _show_dataset(made, console)
    if as_json:
        print(json.dumps(found))


@app.command()
def sense(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    out: Out,
    sensor: Annotated[str, typer.Option(help="isac (the sites), radar (the UV's own), or truth.")] = "isac",
    snr: Annotated[str | None, typer.Option(metavar=SNR_FORMS, help="Per-element SNR, dB, or a link budget.")] = None,
    estimator: Annotated[str | None, typer.Option(help="ml, candan, grid or padded_grid.")] = None,
    fusion: Annotated[str | None, typer.Option(help="information, eq5 or eq5-covariance.")] = None,
    sites: Annotated[int | None, typer.Option(help="Sites used at once, at most.")] = None,
    rain: Annotated[float | None, typer.Option(metavar="MM_PER_H", help="Rain, mm/h.")] = None,
    no_blockage: Annotated[bool, typer.Option("--no-blockage", help="Leave out blockage by other vehicles.")] = False,
    radar: Annotated[str | None, typer.Option(help="Of --sensor radar: clear, nlos or weather.")] = None,
    pattern: Annotated[str | None, typer.Option(help="What --radar nlos loses: random or contiguous.")] = None,
    records: Annotated[
        int | None, typer.Option(help="Records to sense, the dataset's over and over with new echoes.")
    ] = None,
    jobs: Jobs = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The same records, sensed anew; what is not named stays as in the dataset. Resumes where it stopped."""
    from labeling.arguments import resense_settings
    from labeling.dataset import Dataset
    from labeling.engine import LocalEngine
    from labeling.progress import bar
    from labeling.resense import resense

    console, opened = _console(quiet), Dataset.open(dataset)
    settings = resense_settings(
        opened, sensor, snr, estimator, fusion, sites, rain, not no_blockage, radar, pattern, records
    )
    with bar(console, "sensing", "records") as progress:
        made = resense(opened, settings, out, LocalEngine(jobs or _cores()), progress, _note(console, verbose))
    found = _show_dataset(made, console)
    if as_json:
        print(json.dumps(found))


@app.command()
def inspect(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    verify: Annotated[bool, typer.Option("--verify", help="Reread every shard against its digest.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """What is in a dataset: counts, how its events look, rates, seeds, SNR."""
    from labeling.dataset import Dataset

    opened = Dataset.open(dataset)
    if verify:
        opened.verify()
    found = _show_dataset(opened, _console(quiet))
    if as_json:
        print(json.dumps({**found, "verified": verify}))


@app.command()
def train(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    out: Out,
    model: Annotated[
        str, typer.Option(help="The predictor: asi-bip, castformer, trees, ensemble or a floor.")
    ] = "asi-bip",
    epochs: Annotated[int | None, typer.Option(min=1, help="Epochs at most.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of initial weights, window ends and batches.")] = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A trained predictor; resumes where it stopped."""
    from labeling.dataset import Dataset
    from labeling.study import checked
    from models.castformer import PAPER_OPTIMISER
    from models.run import TrainSettings
    from models.training import train as train_predictor

    optimiser = (PAPER_OPTIMISER if model == "castformer" else {}) | ({} if epochs is None else {"epochs": epochs})
    settings = checked(TrainSettings, {"model": model, "seed": seed, "optimiser": optimiser}, "arguments")
    console = _console(quiet)
    made = train_predictor(Dataset.open(dataset), out, settings, console)
    card = made.card
    if card.validation_macro_f1 is not None:
        said = f"best epoch {card.best_epoch}, validation macro-F1 {card.validation_macro_f1:.3f}"
        console.print(f"{said}, {card.parameters} parameters")
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


@network_app.command("import")
def network_import(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="OpenStreetMap file: .osm, .osm.xml, or gzipped.")],
    out: Out,
    box: Annotated[str | None, typer.Option(metavar="W,S,E,N", help="Part of the map, degrees.")] = None,
    spacing: Spacing = None,
    set_back: SetBack = None,
    height: Height = None,
    vehicles: Vehicles = None,
    seed: DemandSeed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A scenario from a map: network, demand, and sites along the roads."""
    from isacsim.network import import_map
    from labeling.arguments import box_of

    part = None if box is None else box_of(box)
    made = import_map(source, out, part, *_placed(spacing, set_back, height, vehicles), seed)
    _show_scenario(made, str(source), _console(quiet), as_json)


@network_app.command("sites")
def network_sites(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="Folder, .sumocfg or .net.xml.")],
    out: Out,
    spacing: Spacing = None,
    set_back: SetBack = None,
    height: Height = None,
    vehicles: Vehicles = None,
    seed: DemandSeed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A scenario with sites along its roads, and demand where it has none; nothing is written beside the original."""
    from isacsim.network import add_sites

    made = add_sites(scenario, out, *_placed(spacing, set_back, height, vehicles), seed)
    _show_scenario(made, scenario, _console(quiet), as_json)


@app.command()
def bench(
    what: Annotated[str, typer.Argument(metavar="echo|traffic|generate|train|infer", help="What to time.")],
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Speeds as ratios against a stated reference, measured in one run on one thread; a minute or two each."""
    from benchmarks import run as run_bench

    found = run_bench(what)
    _console(quiet).print_json(data=found)
    if as_json:
        print(json.dumps(found))


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
    except RunError as error:
        return _complain(str(error), 1)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:
        if error.errno not in NO_ROOM:
            traceback.print_exc()
            return 1
        return _complain(str(output_error(error.filename or "the output", error)), 1)
    except Exception:
        traceback.print_exc()
        return 1
    # Newer typers turn Ctrl-C into this code themselves.
    return _complain(KEPT, code) if code == INTERRUPTED else code


def _complain(message: str, code: int) -> int:
    print(f"cosim: {' '.join(message.split())}", file=sys.stderr)
    return code


def _show_dataset(dataset: Dataset, console: Console) -> dict[str, Any]:
    """What is in a dataset, for people, and what is amiss with it. Returns its summary."""
    from labeling.summary import faults, show, summary

    found = summary(dataset)
    show(found, console)
    for fault in faults(found):
        print(f"warning: {fault}", file=sys.stderr)
    return found


def _show_estimate(study: DatasetStudy, jobs: int, console: Console, as_json: bool) -> None:
    """What a study would take, for people and as JSON."""
    from labeling.estimate import estimate

    found = estimate(study)
    seconds = found.cpu_s / min(jobs, found.episodes)
    console.print(f"1 cell: about {found.episodes} episodes, {found.samples} samples, {found.bytes / 1e6:.0f} MB")
    console.print(
        f"about {found.cpu_s / 60:.0f} minutes of processor time, {seconds / 60:.0f} minutes on {jobs} workers"
    )
    console.print("by what the bundled motorway takes; training and evaluation come on top", soft_wrap=True)
    if as_json:
        print(json.dumps({"cells": 1, **dataclasses.asdict(found), "jobs": jobs, "seconds": round(seconds, 1)}))


def _placed(
    spacing: float | None, set_back: float | None, height: float | None, vehicles: int | None
) -> tuple[PlacementSettings, DemandSettings]:
    """Where poles stand and how much traffic is made, by the arguments."""
    from isacsim.demand import DemandSettings
    from isacsim.site_placement import PlacementSettings
    from labeling.study import checked

    places = {"spacing_m": spacing, "set_back_m": set_back, "height_m": height}
    given = {name: value for name, value in places.items() if value is not None}
    placement = checked(PlacementSettings, given, "arguments")
    return placement, checked(DemandSettings, {} if vehicles is None else {"vehicles": vehicles}, "arguments")


def _show_scenario(made: Made, source: str, console: Console, as_json: bool) -> None:
    """What a scenario was made of, for people and as JSON."""
    if made.overridden:
        _tell(console)(source, made.overridden)
    demand = "demand was made" if made.made_demand else "its own demand"
    console.print(f"{made.folder}: {made.sites} sites along {made.edges} edges; {demand}", soft_wrap=True)
    if as_json:
        print(json.dumps({**dataclasses.asdict(made), "folder": str(made.folder)}))


def _tell(console: Console) -> Callable[[str, Sequence[str]], None]:
    """What tells a person which options of a scenario's configuration are overridden."""

    def tell(scenario: str, options: Sequence[str]) -> None:
        line = f"{scenario}: the time base and outputs are the tool's own; not followed: {', '.join(options)}"
        console.print(line, highlight=False, soft_wrap=True, markup=False)

    return tell


def _note(console: Console, verbose: bool) -> Note | None:
    """What tells a person how every episode ended, where that is asked for."""
    if verbose and console.quiet:
        raise InputError("--quiet and --verbose contradict each other; give one of them")
    return (lambda entry: console.print(str(entry), highlight=False, soft_wrap=True, markup=False)) if verbose else None


def _show_metrics(found: dict[str, Any], console: Console) -> None:
    """What an evaluation found, for people."""
    from models import report

    console.print(report.table(found))
    for line in report.verdict(found):
        console.print(line, soft_wrap=True)


def _console(quiet: bool) -> Console:
    """Where people's output goes: standard error, or nowhere."""
    from rich.console import Console

    return Console(stderr=True, quiet=quiet)


def _engine(jobs: int | None, cluster: str | None) -> Engine:
    """What makes episodes: own worker processes, or those of a running scheduler."""
    from labeling.engine import ClusterEngine, LocalEngine

    if cluster is None:
        return LocalEngine(jobs or _cores())
    if jobs is not None:
        raise InputError("--jobs is of own worker processes and --cluster of a scheduler's; give one of them")
    return ClusterEngine(cluster)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


if __name__ == "__main__":
    sys.exit(main())
