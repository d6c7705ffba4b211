"""Options of one command each, command by command; those that several commands share are in `options`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from isac_cosim.command_line.options import SOURCES

# run
Study = Annotated[Path | None, typer.Argument(help="Study file (.toml). Default: the bundled quick study.")]
StudyFolder = Annotated[
    Path | None, typer.Option("-o", "--out", help="Folder to write. Default: the study's name, under results/.")
]

# generate
Scenarios = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="SCENARIO",
        help="Name of a bundled scenario, folder, .sumocfg or .net.xml, or what else the source reads; one or "
        "more. Default: what the source has for itself.",
    ),
]
Samples = Annotated[
    int | None, typer.Option(min=1, help="Stop when there are this many samples. Default: use every seed.")
]
Windows = Annotated[int | None, typer.Option("--windows", min=1, hidden=True)]
AsStreams = Annotated[
    bool,
    typer.Option("--streams", help="Store every watched stretch of driving, to cut windows from, in place of samples."),
]
GeneratedSeeds = Annotated[
    str | None,
    typer.Option(metavar="A:B", help="Seeds of the traffic, from A to B inclusive. Default: 1:20; of streams, 1:14."),
]
Undisturbed = Annotated[
    bool, typer.Option("--natural", help="Leave the drivers alone: no causes, commands or disturbances.")
]
Drivers = Annotated[
    str, typer.Option(metavar="theirs|ours", help="Who drives: the demand's own vehicle types, or our drivers.")
]
Departures = Annotated[
    str,
    typer.Option(
        metavar="as-given|drawn", help="Departures: as the demand says, or up to 60 s later, drawn for each seed."
    ),
]

# sense
Sensor = Annotated[str | None, typer.Option(help="What senses the target vehicle: {sensors}. Default: isac.")]
Estimator = Annotated[str | None, typer.Option(help="How angle, delay and Doppler are estimated: {estimators}.")]
Fusion = Annotated[
    str | None, typer.Option(help="How the sites' measurements are fused: {fusion_methods}, eq5-covariance.")
]
MostSites = Annotated[int | None, typer.Option(help="Use at most this many sites at once.")]
Rain = Annotated[float | None, typer.Option(metavar="MM_PER_H", help="Rain rate, mm/h.")]
NoBlockage = Annotated[bool, typer.Option("--no-blockage", help="Ignore blockage by other vehicles.")]
RadarCondition = Annotated[
    str | None, typer.Option(help="Condition of the onboard radar (with --sensor radar): clear, nlos, weather.")
]
LostCycles = Annotated[
    str | None, typer.Option(help="Which cycles the radar loses (with --radar nlos): random, contiguous.")
]
SensedRecords = Annotated[
    int | None, typer.Option(help="Sense this many records, repeating the dataset's with new noise as needed.")
]
RadarPreset = Annotated[
    str | None, typer.Option(help="Which onboard radar (with --sensor radar): long_range, framework (400 Hz).")
]

# inspect
Verify = Annotated[bool, typer.Option("--verify", help="Reread every shard and check its digest.")]

# train
Model = Annotated[
    str | None,
    typer.Option(
        help="Predictor to train. On records: {predictors}; default {predictor}. On streams: {stream_predictors}; "
        "default {stream_predictor}."
    ),
]
Epochs = Annotated[int | None, typer.Option(min=1, help="Train for at most this many epochs.")]
TrainingSeed = Annotated[
    int | None,
    typer.Option(min=0, max=2**32 - 1, help="Seed of initial weights, window ends and batches. Default: 0."),
]
HeldOut = Annotated[
    str | None,
    typer.Option(metavar="INTENTION", help="Leave this intention out of training; it is then unknown in evaluation."),
]
TrainingShare = Annotated[
    float | None,
    typer.Option(
        metavar="SHARE",
        help="Train on this share of the training seeds, to see what more driving would give. Default: 1.",
    ),
]
SeesUv = Annotated[
    bool | None,
    typer.Option("--uv/--no-uv", help="On streams: whether the predictor sees the UV's reports; by default it does."),
]
SeesLanes = Annotated[
    bool | None,
    typer.Option("--lanes/--no-lanes", help="On streams: whether the predictor sees the lanes; by default it does."),
]
TrueTraining = Annotated[
    bool | None, typer.Option("--truth", help="On streams: train on the TVs' true motion.", show_default=False)
]
TrainingStudy = Annotated[
    Path | None,
    typer.Option(
        "--study", metavar="FILE", help="Take the settings of [training] from this study; options replace its own."
    ),
]
Log = Annotated[
    str | None,
    typer.Option(metavar="tensorboard", help="Write the curves of a network for TensorBoard as well, into the run."),
]

# evaluate
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a trained predictor.")]
EvaluatedDataset = Annotated[
    Path | None, typer.Option("--data", metavar="DATASET", help="Dataset; only seeds unseen in training are used.")
]
EvaluationFolder = Annotated[
    Path | None,
    typer.Option(
        "-o", "--out", help="Folder to write. Default: evaluation/, or traffic-SCENARIO/, in the run's folder."
    ),
]
Against = Annotated[
    list[Path] | None,
    typer.Option("--against", metavar="RUN", help="Compare with another run on the same windows; repeatable."),
]
Explain = Annotated[
    bool, typer.Option("--explain", help="With --data: show attention, gates and weights of a CaSTFormer.")
]
TrafficScenario = Annotated[
    str | None,
    typer.Option(
        "--traffic",
        metavar="SCENARIO",
        help="Evaluate live in running traffic: name of a bundled scenario, folder, .sumocfg, or file of trajectories.",
    ),
]
TrafficSource = Annotated[
    str | None, typer.Option("--source", help=f"With --traffic: where motion comes from: {SOURCES}")
]
MeasuredSeeds = Annotated[
    str | None,
    typer.Option(
        metavar="A:B", help="With --traffic: seeds that are measured, from A to B inclusive. Default: 1001:1004."
    ),
]
DevelopmentSeeds = Annotated[
    str | None,
    typer.Option(
        metavar="A:B", help="With --traffic: seeds on which alarms are chosen. Default: from 2001 on, 30 vehicle-hours."
    ),
]
Duration = Annotated[
    float | None,
    typer.Option(metavar="S", min=1.0, help="With --traffic: simulated time of each seed, s. Default: the dataset's."),
]
FalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--false-alarms",
        metavar="RATE",
        help="With --traffic: choose alarms with at most so many false ones per vehicle-hour. Default: 1.",
    ),
]
TrueMotion = Annotated[
    bool,
    typer.Option("--truth", help="With --traffic: also predict from true motion, to measure what sensing costs."),
]
LiveScene = Annotated[
    bool | None,
    typer.Option(
        "--scene/--no-scene",
        help="With --traffic: whether the sites sense all vehicles at once. Default: as in the run's dataset.",
        show_default=False,
    ),
]
InLane = Annotated[
    bool | None,
    typer.Option(
        "--lanes/--no-lanes",
        help="With --traffic: trees with the answer 'none' also see the lanes, recent motion and the UV. Default: yes.",
        show_default=False,
    ),
]
AloneRun = Annotated[
    Path | None,
    typer.Option(
        metavar="RUN",
        help="With --traffic: a tv-alone predictor for vehicles without a connected leader.",
    ),
]
NaturalTraffic = Annotated[
    bool,
    typer.Option(
        "--natural", help="With --traffic: leave the drivers alone, without causes or commands. That is the default."
    ),
]
Stress = Annotated[
    bool,
    typer.Option(
        "--stress",
        help="With --traffic: also measure the stimulated world, on the same seeds. Doubles the cost.",
    ),
]
Advisories = Annotated[
    bool,
    typer.Option(
        "--advisories",
        help="With --traffic: also close the loop: advisories to connected vehicles on alarms, in several arms. In the "
        "stimulated world, because natural traffic has hardly a conflict.",
    ),
]
ConditioningKind = Annotated[
    str | None,
    typer.Option(
        "--conditioning",
        metavar="KIND",
        help="With --advisories: how running traffic is smoothed, trailing (0.6 s late) or causal. Default: trailing.",
    ),
]

# reproduce
Paper = Annotated[str, typer.Argument(metavar="PAPER", help="Paper to reproduce: {papers}.")]
ReproductionFolder = Annotated[
    Path | None, typer.Option("-o", "--out", help="Folder to write. Default: the paper's name, under results/.")
]
QuickSize = Annotated[
    bool, typer.Option("--quick", help="Run every stage on little data: minutes, and figures that mean nothing.")
]
Stages = Annotated[
    str | None, typer.Option(metavar="NAME,NAME", help="Run these stages or groups of stages. Default: all.")
]
Clips = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="With castformer: use these feature files, as of Brain4Cars.")
]
Background = Annotated[
    str | None,
    typer.Option(
        metavar="CLASS", help="With --clips: the class that drives straight on, or none, unless the files say."
    ),
]
PaperEpochs = Annotated[int | None, typer.Option(min=1, help="Train the paper's network for this many epochs.")]
PaperJobs = Annotated[
    int | None, typer.Option("--jobs", min=1, max=1024, help="Worker processes. Default: as many as make it short.")
]

# replay
RunOrDataset = Annotated[
    Path, typer.Argument(metavar="RUN|DATASET", help="Folder of a trained predictor, or a dataset.")
]
Episode = Annotated[str, typer.Option("--episode", metavar="SCENARIO-SEED", help="The episode to show.")]
Page = Annotated[Path, typer.Option("-o", "--out", metavar="PAGE", help="Page to write, ends in .html.")]
ReplayData = Annotated[
    Path | None,
    typer.Option(
        "--data", metavar="DATASET", help="Dataset of the episode. Default: the one beside the run, as in a study."
    ),
]

# bench
Bench = Annotated[str | None, typer.Argument(metavar="NAME", help="What to measure: {benches}.")]
EveryBench = Annotated[bool, typer.Option("--all", help="Run all of them and show one table of ratios.")]
