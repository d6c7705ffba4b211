"""Options that several commands share, and what they stand for.

The packages are imported inside the functions, so that help and usage errors answer at once.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.sources import DEFAULT

if TYPE_CHECKING:
    from isac_cosim.base.workers.engine import Engine
    from isac_cosim.isacsim.scenarios.demand import DemandSettings
    from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings


def _print_version(asked: bool) -> None:
    from isac_cosim.isacsim.traffic.sources.sumo_library import load_libsumo

    if asked:
        load_libsumo()  # refuses another SUMO than the installed one, which would answer in its place
        print(f"isac-cosim {version('isac-cosim')}, SUMO {version('libsumo')}, torch {version('torch')}")
        raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version", callback=_print_version, is_eager=True, help="Print the versions of this tool, SUMO and torch."
    ),
]
DatasetFolder = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset.")]
Out = Annotated[
    Path, typer.Option("-o", "--out", help="Folder to write: a new or empty one, or an unfinished one to continue.")
]
Model = Annotated[
    str | None,
    typer.Option(
        help="Predictor to train. On records: {predictors}; default {predictor}. On streams: {stream_predictors}; "
        "default {stream_predictor}."
    ),
]
Epochs = Annotated[int | None, typer.Option(min=1, help="Train for at most this many epochs.")]
TrainingSeed = Annotated[
    int, typer.Option(min=0, max=2**32 - 1, help="Seed of initial weights, window ends and batches.")
]
HeldOut = Annotated[
    str | None,
    typer.Option(metavar="INTENTION", help="Leave this intention out of training; it is then unknown in evaluation."),
]
SeesUv = Annotated[bool, typer.Option("--uv/--no-uv", help="On streams: whether the predictor sees the UV's reports.")]
SeesLanes = Annotated[
    bool, typer.Option("--lanes/--no-lanes", help="On streams: whether the predictor sees the lanes.")
]
TrueTraining = Annotated[bool, typer.Option("--truth", help="On streams: train on the TVs' true motion.")]
Snr = Annotated[
    str | None,
    typer.Option(
        metavar="LO:HI|VALUE|link",
        help="SNR per antenna element, dB: a range to draw from, one value, or `link` for the link budget.",
    ),
]
Log = Annotated[
    str | None,
    typer.Option(metavar="tensorboard", help="Write the curves of a network for TensorBoard as well, into the run."),
]
Network = Annotated[
    str | None,
    typer.Option(
        metavar="SCENARIO",
        help="With a --source of trajectory files: the scenario, network or Lanelet2 map (.osm) that was driven on.",
    ),
]
Scene = Annotated[
    bool,
    typer.Option("--scene", help="The sites sense all vehicles at once, and have to find out who is who."),
]
Jobs = Annotated[int | None, typer.Option(min=1, max=1024, help="Worker processes. Default: one per core.")]
Cluster = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Use the workers of a running dask scheduler, tls://HOST:PORT.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, last on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print only warnings and errors to standard error.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print a line to standard error for every episode.")]
TrafficScenario = Annotated[
    str | None,
    typer.Option(
        "--traffic",
        metavar="SCENARIO",
        help="Evaluate live in running traffic: name of a bundled scenario, folder, .sumocfg, or file of trajectories.",
    ),
]
SOURCES = f"{{motion_sources}}. Default: {DEFAULT}; files of trajectories are recognised."
Source = Annotated[str | None, typer.Option("--source", help=f"Where motion comes from: {SOURCES}")]
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
RadarPreset = Annotated[
    str | None, typer.Option(help="Which onboard radar (with --sensor radar): long_range, framework (400 Hz).")
]
Explain = Annotated[
    bool, typer.Option("--explain", help="With --data: show attention, gates and weights of a CaSTFormer.")
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
PaperJobs = Annotated[
    int | None, typer.Option("--jobs", min=1, max=1024, help="Worker processes. Default: as many as make it short.")
]
PaperEpochs = Annotated[int | None, typer.Option(min=1, help="Train the paper's network for this many epochs.")]
CostOnly = Annotated[bool, typer.Option("--dry-run", help="Only estimate the cost; write nothing.")]
Spacing = Annotated[
    float | None, typer.Option(metavar="M", help="Distance between masts along the road, m. Default: {spacing_m}.")
]
SetBack = Annotated[
    float | None, typer.Option(metavar="M", help="Distance of masts from the road's edge, m. Default: {set_back_m}.")
]
Height = Annotated[
    float | None, typer.Option(metavar="M", help="Height of the antennas above the road, m. Default: {height_m}.")
]
Vehicles = Annotated[
    int | None,
    typer.Option(help="About how many vehicles are on the road at once, where demand is made. Default: {vehicles}."),
]
DemandSeed = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**32 - 1, help="Seed of the demand, where demand is made. Default: 0."),
]


def engine_of(jobs: int | None, cluster: str | None, out: Path) -> Engine:
    """Return what runs episodes: local worker processes, or a running scheduler's workers, which are checked first.

    out: the folder that the command writes.
    """
    from isac_cosim.base.workers.engine import LocalEngine

    if cluster is None:
        return LocalEngine(jobs or cores(), out.absolute())
    if jobs is not None:
        raise InputError("--jobs is for local worker processes and --cluster for a scheduler's; give one of them")
    from isac_cosim.base.workers.cluster import ClusterEngine

    engine = ClusterEngine(cluster, out.absolute())
    engine.check()
    if not engine.encrypted:
        print(
            f"warning: --cluster {cluster}: without TLS, everyone who can connect to this scheduler can run code as "
            "you; docs/cluster.md says how to use tls://",
            file=sys.stderr,
        )
    return engine


def placement_of(
    spacing: float | None, set_back: float | None, height: float | None, vehicles: int | None
) -> tuple[PlacementSettings, DemandSettings]:
    """Return where masts stand and how much traffic is made, from the arguments."""
    from isac_cosim.base.settings import checked
    from isac_cosim.isacsim.scenarios.demand import DemandSettings
    from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings

    arguments = {"spacing_m": spacing, "set_back_m": set_back, "height_m": height}
    given = {name: value for name, value in arguments.items() if value is not None}
    placement = checked(PlacementSettings, given, "arguments")
    return placement, checked(DemandSettings, {} if vehicles is None else {"vehicles": vehicles}, "arguments")


def cores() -> int:
    """Return how many processor cores this process may use, its affinity and the container's limit considered."""
    from isac_cosim.base.workers.engine import cpu_count

    return cpu_count()
