"""The command line, as a table of contents: every command reads its arguments, makes one call and shows the result.

The packages are imported inside the commands, so that help and usage errors answer at once.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import typer

from isac_cosim.base.errors import InputError
from isac_cosim.command_line import options as opt
from isac_cosim.command_line import output
from isac_cosim.command_line import own_options as own
from isac_cosim.command_line.commands.registration import add_commands
from isac_cosim.command_line.exit_codes import exit_code
from isac_cosim.command_line.help import NO_COMMAND, HelpfulCommand, examples
from isac_cosim.isacsim.traffic.sources import DEFAULT as DEFAULT_SOURCE
from isac_cosim.models import FLOOR

app = typer.Typer(
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="From a SUMO road network to an evaluated predictor of driver intentions, fed by simulated ISAC sensing.",
)


@app.callback(invoke_without_command=True)
def common(context: typer.Context, version: opt.Version = False) -> None:
    """Take the options that come before a command."""
    if context.invoked_subcommand is None:
        raise InputError(NO_COMMAND)


@app.command(
    cls=HelpfulCommand, epilog=examples("run", "run my_study.toml -o results/mine", "run my_study.toml --dry-run")
)
def run(
    study: own.Study = None,
    out: own.StudyFolder = None,
    dry_run: opt.CostOnly = False,
    jobs: opt.Jobs = None,
    cluster: opt.Cluster = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Run a whole study: generate, train, evaluate and report; or a sweep of studies, with one table.

    Repeat the command to continue an interrupted study.
    """
    from isac_cosim.command_line.study import run_and_show, show_cost
    from isac_cosim.studies.study import read_study

    began, console = time.monotonic(), output.console_of(quiet)
    content = read_study(study)
    content.check_scenarios()
    if dry_run:
        if cluster is not None:
            raise InputError("--cluster runs a study, and --dry-run counts on local workers: give --jobs in its place")
        output.print_json(as_json, show_cost(content, jobs or opt.cores(), console))
        return
    feedback = output.feedback_of(console, verbose)
    folder = out or Path("results") / content.name
    result = run_and_show(content, folder, opt.engine_of(jobs, cluster, folder), feedback)
    output.print_json(as_json, {**result, "seconds": round(time.monotonic() - began, 1)})
    output.fail_if_incomplete(result)


@app.command(
    cls=HelpfulCommand,
    epilog=examples(
        "generate motorway -o data --samples 500",
        "generate my_net.sumocfg -o data --seeds 1:40 --snr link",
        "generate -o data --source kinematic --samples 7200",
        "generate motorway -o streams --streams --snr link",
    ),
)
def generate(
    out: opt.Out,
    scenarios: own.Scenarios = None,
    source: opt.Source = None,
    samples: own.Samples = None,
    windows: own.Windows = None,
    streams: own.AsStreams = False,
    seeds: own.GeneratedSeeds = None,
    snr: opt.Snr = None,
    scene: opt.Scene = False,
    natural: own.Undisturbed = False,
    drivers: own.Drivers = "theirs",
    demand: own.Departures = "as-given",
    network: opt.Network = None,
    jobs: opt.Jobs = None,
    cluster: opt.Cluster = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Generate a labelled dataset, or streams, from simulated traffic or another source of motion.

    Repeat the command to continue an interrupted dataset.
    """
    from isac_cosim.command_line.arguments import STREAM_SEEDS, dataset_study, one_of
    from isac_cosim.isacsim.traffic.sources.registry import recognised

    console = output.console_of(quiet)
    wanted = one_of(samples, windows)
    if streams and wanted is not None:
        raise InputError("--samples counts records, and --streams stores whole episodes: give --seeds in its place")
    source = source or recognised(scenarios or [])
    chosen = STREAM_SEEDS if streams and seeds is None and source == DEFAULT_SOURCE else seeds
    study = dataset_study(scenarios or [], wanted, chosen, snr, source, natural, drivers, demand, scene, network)
    feedback, engine = output.feedback_of(console, verbose), opt.engine_of(jobs, cluster, out)
    if streams:
        from isac_cosim.command_line.streams import generate_and_show
    else:
        from isac_cosim.command_line.generation import generate_and_show
    output.print_json(as_json, generate_and_show(study, out, engine, feedback, console))


@app.command(
    cls=HelpfulCommand,
    epilog=examples("sense data -o data_noisy --snr -10:0", "sense data -o data_radar --sensor radar --radar weather"),
)
def sense(
    dataset: opt.DatasetFolder,
    out: opt.Out,
    sensor: own.Sensor = None,
    snr: opt.Snr = None,
    scene: opt.Scene = False,
    estimator: own.Estimator = None,
    fusion: own.Fusion = None,
    sites: own.MostSites = None,
    rain: own.Rain = None,
    no_blockage: own.NoBlockage = False,
    radar: own.RadarCondition = None,
    radar_preset: own.RadarPreset = None,
    pattern: own.LostCycles = None,
    records: own.SensedRecords = None,
    jobs: opt.Jobs = None,
    cluster: opt.Cluster = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Sense the records of a dataset again with other settings.

    Settings that are not given stay as in the dataset. Repeat the command to continue where it was interrupted.
    """
    from isac_cosim.command_line.arguments import SenseArguments, resense_settings
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.labeling.generation.resense import resense

    console, source = output.console_of(quiet), Dataset.open(dataset)
    feedback = output.feedback_of(console, verbose)
    channel = sensor, snr, estimator, fusion, sites, rain, not no_blockage
    arguments = SenseArguments(*channel, radar, pattern, records, scene, radar_preset)
    settings = resense_settings(source, arguments)
    sensed = resense(source, settings, out, opt.engine_of(jobs, cluster, out), feedback)
    output.print_json(as_json, output.show_dataset(sensed, console))


@app.command(cls=HelpfulCommand, epilog=examples("inspect data", "inspect data --verify --json"))
def inspect(
    dataset: opt.DatasetFolder,
    verify: own.Verify = False,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Show what is in a dataset: counts by intention and origin, distributions, rates, seeds, SNR; hours of streams."""
    from isac_cosim.command_line.streams import inspect_and_show
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.labeling.streams.dataset import META_FILE

    if (dataset / META_FILE).is_file():
        output.print_json(as_json, inspect_and_show(dataset, verify, output.console_of(quiet)))
        return
    opened = Dataset.open(dataset)
    if verify:
        opened.verify()
    output.print_json(as_json, {**output.show_dataset(opened, output.console_of(quiet)), "verified": verify})


@app.command(
    cls=HelpfulCommand,
    epilog=examples(
        "train data -o predictor",
        f"train data -o floor --model {FLOOR}",
        "train data -o run_2 --seed 2 --epochs 40",
        "train streams -o predictor --model situation",
    ),
)
def train(
    dataset: opt.DatasetFolder,
    out: opt.Out,
    model: own.Model = None,
    epochs: own.Epochs = None,
    seed: own.TrainingSeed = None,
    held_out: own.HeldOut = None,
    training_share: own.TrainingShare = None,
    uv: own.SeesUv = None,
    lanes: own.SeesLanes = None,
    truth: own.TrueTraining = None,
    study: own.TrainingStudy = None,
    log: own.Log = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Train a predictor on a dataset, or on streams.

    Repeat the command to continue an interrupted training.
    """
    from isac_cosim.command_line.training import TrainArguments, train_and_show

    arguments = TrainArguments(model, epochs, seed, held_out, training_share, uv, lanes, truth, log, study)
    output.print_json(as_json, train_and_show(dataset, out, arguments, output.console_of(quiet)))


@app.command(
    cls=HelpfulCommand,
    epilog=examples(
        "evaluate predictor --data data",
        "evaluate predictor --data data --against floor",
        "evaluate predictor --traffic motorway --duration 120",
        "evaluate predictor --traffic motorway --stress",
        "evaluate predictor --traffic motorway --duration 60 --advisories",
    ),
)
def evaluate(
    run: own.RunFolder,
    data: own.EvaluatedDataset = None,
    traffic: own.TrafficScenario = None,
    out: own.EvaluationFolder = None,
    against: own.Against = None,
    explain: own.Explain = False,
    seeds: own.MeasuredSeeds = None,
    development: own.DevelopmentSeeds = None,
    duration: own.Duration = None,
    false_alarms: own.FalseAlarms = None,
    truth: own.TrueMotion = False,
    lanes: own.InLane = None,
    alone: own.AloneRun = None,
    scene: own.LiveScene = None,
    source: own.TrafficSource = None,
    network: opt.Network = None,
    natural: own.NaturalTraffic = False,
    stress: own.Stress = False,
    advisories: own.Advisories = False,
    conditioning: own.ConditioningKind = None,
    jobs: opt.Jobs = None,
    cluster: opt.Cluster = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Evaluate a predictor on a dataset, or live in running traffic: metrics and figures.

    An evaluation in traffic that was interrupted is continued by the same command.
    """
    from isac_cosim.command_line import evaluation
    from isac_cosim.command_line.live import LiveArguments, evaluate_and_show, source_of

    live = LiveArguments(
        seeds=seeds,
        development=development,
        duration=duration,
        jobs=jobs,
        natural=natural,
        stress=stress,
        advisories=advisories,
        conditioning=conditioning,
        false_alarms=false_alarms,
        truth=truth,
        alone=alone,
        cluster=cluster,
        lanes=lanes,
        source=source,
        network=network,
        scene=scene,
    )
    console, others = output.console_of(quiet), against or ()
    if source_of(data, traffic, live) == "traffic":
        if explain:
            raise InputError("--explain applies to windows of a dataset: give --data DATASET")
        result = evaluate_and_show(run, str(traffic), live, out, others, console)
    else:
        assert data is not None
        result = evaluation.evaluate_and_show(run, data, out, others, console, explain)
    output.print_json(as_json, result)


@app.command(
    cls=HelpfulCommand,
    epilog=examples(
        "reproduce asi-bip --dry-run",
        "reproduce castformer --quick",
        "reproduce asi-bip -o results/paper --stages table1,fig5",
    ),
)
def reproduce(
    paper: own.Paper,
    out: own.ReproductionFolder = None,
    quick: own.QuickSize = False,
    stages: own.Stages = None,
    clips: own.Clips = None,
    background: own.Background = None,
    epochs: own.PaperEpochs = None,
    dry_run: opt.CostOnly = False,
    jobs: own.PaperJobs = None,
    cluster: opt.Cluster = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Reproduce the experiments of a paper: its tables and figures beside ours, and a verdict on each claim.

    Repeat the command to continue an interrupted reproduction.
    """
    from isac_cosim.command_line.reproduction import engine_for, reproduce_and_show, show_cost
    from isac_cosim.studies.reproduction.reproduce import request

    folder = out or Path("results") / (f"{paper}-quick" if quick else paper)
    wanted = request(paper, folder, quick, stages.split(",") if stages else None, clips, epochs, background)
    show = show_cost if dry_run else reproduce_and_show
    output.print_json(as_json, show(wanted, engine_for(wanted, jobs, cluster), output.console_of(quiet)))


@app.command(cls=HelpfulCommand, epilog=examples("replay results/quick/run --episode motorway-3 -o replay.html"))
def replay(
    source: own.RunOrDataset,
    episode: own.Episode,
    page: own.Page,
    data: own.ReplayData = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Make a page on which the records of an episode, which is simulated again, move on the road, seen from above."""
    from isac_cosim.command_line.replay import replay_and_show

    output.print_json(as_json, replay_and_show(source, data, episode, page, output.console_of(quiet)))


@app.command(cls=HelpfulCommand, epilog=examples("bench echo", "bench --all --json"))
def bench(
    what: own.Bench = None,
    every: own.EveryBench = False,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Measure speeds as ratios against a stated reference, both in one run; takes minutes."""
    from isac_cosim import benchmarks
    from isac_cosim.benchmarks.ratios import show_bench

    console = output.console_of(quiet)
    benchmarks.check_choice(what, every)
    result = benchmarks.run_all(output.feedback_of(console)) if what is None else benchmarks.run(what)
    show_bench(result, console)
    output.print_json(as_json, result)


add_commands(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code: 0 done, 1 failed, 2 wrong input, 130 interrupted, 143 terminated."""
    # Figures have a canvas of their own. A backend that the caller chose for pyplot need not exist here.
    os.environ["MPLBACKEND"] = "agg"
    return exit_code(lambda: app(arguments, standalone_mode=False))


if __name__ == "__main__":
    sys.exit(main())
