"""The command line: parse, call, print.

The packages are imported inside the commands, so that help and usage errors answer at once.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from command_line.options import (
    AsJson,
    Cluster,
    DatasetFolder,
    DemandSeed,
    Height,
    Jobs,
    Out,
    Quiet,
    SetBack,
    Snr,
    Spacing,
    Vehicles,
    Verbose,
    cores,
    engine_of,
    placed,
)
from command_line.output import (
    console_of,
    failures,
    feedback_of,
    print_json,
    show_dataset,
    show_estimate,
    show_metrics,
    show_scenario,
    show_sweep,
)
from isacsim.errors import NO_ROOM, WRONG_PATH, InputError, RunError, output_error

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="From a SUMO road network to an evaluated driver-intention predictor that sees traffic through ISAC sensing.",
)
network_app = typer.Typer(help="Scenarios made from a map, or from a network without sites.")
app.add_typer(network_app, name="network")
INTERRUPTED = 130
LONGEST = 1000
"""Letters of what is said to be wrong."""
KEPT = "interrupted; what was finished is kept, the same command goes on from there"


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
    """The main job: generate, train, evaluate, report; or all of it for every cell of a sweep."""
    from labeling.dataset.dataset import Dataset
    from labeling.generation.generate import describe, read_scenarios
    from models.report import report
    from models.studies.single import run_study
    from models.studies.study import read_study
    from models.studies.sweep import run_sweep

    began = time.monotonic()
    console, content = console_of(quiet), read_study(study)
    for each in content.networks.values():
        # A network that is at fault is told before anything is written, and before hours go into the others.
        describe(each, read_scenarios(each))
    if dry_run:
        print_json(as_json, show_estimate(content, jobs or cores(), console))
        return
    folder, feedback = out or Path("results") / content.name, feedback_of(console, verbose)
    engine = engine_of(jobs, cluster)
    if content.sweep is not None:
        found = show_sweep(run_sweep(content, folder, engine, feedback), folder, console)
        print_json(as_json, {**found, "seconds": round(time.monotonic() - began, 1)})
        if found["failed"]:
            raise RunError(failures(found))
        return

    found = run_study(content, folder, engine, feedback)
    show_dataset(Dataset.open(folder / "dataset"), console)
    show_metrics(found, console)
    console.print(f"figures and report: {folder / 'report' / report.PAGE}", soft_wrap=True)
    result = {
        "dataset": str(folder / "dataset"),
        "run": str(folder / "run"),
        "report": str(folder / "report"),
        "accuracy": found["accuracy"],
        "macro_f1": found["macro_f1"],
        "floor_macro_f1": found["compared"][0]["macro_f1"],
        "seconds": round(time.monotonic() - began, 1),
    }
    print_json(as_json, result)


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
    snr: Snr = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """A labelled dataset; resumes where it stopped."""
    from command_line.arguments import dataset_study
    from labeling.generation.generate import generate as generate_dataset

    study, console = dataset_study(scenarios, windows, seeds, snr), console_of(quiet)
    dataset = generate_dataset(study, out, engine_of(jobs, cluster), feedback_of(console, verbose))
    print_json(as_json, show_dataset(dataset, console))


@app.command()
def sense(
    dataset: DatasetFolder,
    out: Out,
    sensor: Annotated[str, typer.Option(help="isac (the sites), radar (the UV's own), or truth.")] = "isac",
    snr: Snr = None,
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
    from command_line.arguments import resense_settings
    from labeling.dataset.dataset import Dataset
    from labeling.generation.engine import LocalEngine
    from labeling.generation.resense import resense

    console, opened = console_of(quiet), Dataset.open(dataset)
    feedback = feedback_of(console, verbose)
    settings = resense_settings(
        opened, sensor, snr, estimator, fusion, sites, rain, not no_blockage, radar, pattern, records
    )
    made = resense(opened, settings, out, LocalEngine(jobs or cores()), feedback)
    print_json(as_json, show_dataset(made, console))


@app.command()
def inspect(
    dataset: DatasetFolder,
    verify: Annotated[bool, typer.Option("--verify", help="Reread every shard against its digest.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """What is in a dataset: counts, how its events look, rates, seeds, SNR."""
    from labeling.dataset.dataset import Dataset

    opened = Dataset.open(dataset)
    if verify:
        opened.verify()
    print_json(as_json, {**show_dataset(opened, console_of(quiet)), "verified": verify})


@app.command()
def train(
    dataset: DatasetFolder,
    out: Out,
    model: Annotated[
        str, typer.Option(help="The predictor: asi-bip, castformer, trees, ensemble or a floor.")
    ] = "asi-bip",
    epochs: Annotated[int | None, typer.Option(min=1, help="Epochs at most.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of initial weights, window ends and batches.")] = 0,
    held_out: Annotated[
        str | None, typer.Option(metavar="INTENTION", help="Known intention left out, to be unknown in evaluation.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """A trained predictor; resumes where it stopped."""
    from isacsim.settings import checked
    from labeling.dataset.dataset import Dataset
    from models.predictors.castformer import PAPER_OPTIMISER
    from models.run import TrainSettings
    from models.training.training import train as train_predictor

    optimiser = (PAPER_OPTIMISER if model == "castformer" else {}) | ({} if epochs is None else {"epochs": epochs})
    said = {"model": model, "seed": seed, "held_out": held_out, "optimiser": optimiser}
    settings = checked(TrainSettings, said, "arguments")
    console = console_of(quiet)
    made = train_predictor(Dataset.open(dataset), out, settings, feedback_of(console))
    card = made.card
    if card.validation_macro_f1 is not None:
        best = f"best epoch {card.best_epoch}, validation macro-F1 {card.validation_macro_f1:.3f}"
        console.print(f"{best}, {card.parameters} parameters")
    result = {"run": str(out), "best_epoch": card.best_epoch, "validation_macro_f1": card.validation_macro_f1}
    print_json(as_json, result)


@app.command()
def evaluate(
    run: Annotated[Path, typer.Argument(help="Folder of a trained predictor.")],
    data: Annotated[Path, typer.Option("--data", metavar="DATASET", help="Dataset whose unseen seeds are used.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder to write; RUN/evaluation when absent.")
    ] = None,
    against: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Another run to compare with on the same windows; may be given again."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Metrics and figures of a predictor on windows of traffic it has not seen."""
    from labeling.dataset.dataset import Dataset
    from models.evaluation.evaluation import evaluate as evaluate_run
    from models.report import report
    from models.run import load_run

    console, loaded, dataset = console_of(quiet), load_run(run), Dataset.open(data)
    folder = out or run / "evaluation"
    found = evaluate_run(loaded, dataset, folder, against=[load_run(each) for each in against or ()])
    page = report.write_report(loaded, dataset, folder)
    show_metrics(found, console)
    console.print(f"figures and report: {page}", soft_wrap=True)
    print_json(as_json, {"report": str(folder), **found})


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
    from command_line.arguments import box_of
    from isacsim.scenarios.making import import_map

    part = None if box is None else box_of(box)
    made = import_map(source, out, part, *placed(spacing, set_back, height, vehicles), seed)
    print_json(as_json, show_scenario(made, str(source), console_of(quiet)))


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
    from isacsim.scenarios.making import add_sites

    made = add_sites(scenario, out, *placed(spacing, set_back, height, vehicles), seed)
    print_json(as_json, show_scenario(made, scenario, console_of(quiet)))


@app.command()
def bench(
    what: Annotated[str, typer.Argument(metavar="echo|traffic|generate|train|infer", help="What to time.")],
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Speeds as ratios against a stated reference, measured in one run; a minute or two each, `generate` several."""
    from benchmarks import run as run_bench

    found = run_bench(what)
    console_of(quiet).print_json(data=found)
    print_json(as_json, found)


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
        if error.errno in NO_ROOM:
            return _complain(str(output_error(error.filename or "the output", error)), 1)
        if error.errno in WRONG_PATH and error.filename is not None:
            return _complain(f"{error.filename}: cannot be used ({error.strerror}); mend that, or give another path", 2)
        traceback.print_exc()
        return 1
    except Exception:
        traceback.print_exc()
        return 1
    # Newer typers turn Ctrl-C into this code themselves.
    return _complain(KEPT, code) if code == INTERRUPTED else code


def _complain(message: str, code: int) -> int:
    """Say what is wrong in one line, without what a terminal would obey, and not endlessly. Returns the code."""
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(message.split()))
    print(f"cosim: {line if len(line) <= LONGEST else line[:LONGEST] + '...'}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
