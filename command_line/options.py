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
Snr = Annotated[
    str | None,
    typer.Option(
        metavar="LO:HI|VALUE|link",
        help="SNR per antenna element, dB: a range to draw from, one value, or `link` for the link budget.",
    ),
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
SOURCES = f"{{motion_sources}}. Default: {DEFAULT}; files of trajectories are recognised."
Source = Annotated[str | None, typer.Option("--source", help=f"Where motion comes from: {SOURCES}")]
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
