"""Options that several commands have, and what they stand for.

The packages are imported inside the functions, so that help and usage errors answer at once.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isacsim.errors import InputError

if TYPE_CHECKING:
    from isacsim.scenarios.demand import DemandSettings
    from isacsim.scenarios.site_placement import PlacementSettings
    from labeling.generation.engine import Engine

DatasetFolder = Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset.")]
Out = Annotated[Path, typer.Option("-o", "--out", help="Folder to write; a new or empty one, or one to go on with.")]
Snr = Annotated[
    str | None,
    typer.Option(metavar="LO:HI|VALUE|link", help="Per-element SNR, dB: a range to draw from, or a link budget."),
]
Jobs = Annotated[int | None, typer.Option(min=1, max=1024, help="Worker processes; the number of cores when absent.")]
Cluster = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A running dask scheduler, instead of own worker processes.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on standard output, last.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Only warnings and errors on standard error.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="A line on standard error for every episode.")]
Spacing = Annotated[float | None, typer.Option(metavar="M", help="Between poles along the road, m.")]
SetBack = Annotated[float | None, typer.Option(metavar="M", help="Of poles from the road's edge, m.")]
Height = Annotated[float | None, typer.Option(metavar="M", help="Of the antennas above the road, m.")]
Vehicles = Annotated[int | None, typer.Option(help="Vehicles on the road at once, about, where demand is made.")]
DemandSeed = Annotated[int, typer.Option("--seed", help="Seed of the demand that is made.")]


def engine_of(jobs: int | None, cluster: str | None) -> Engine:
    """What makes episodes: own worker processes, or those of a running scheduler, which is asked whether it is fit."""
    from labeling.generation.engine import ClusterEngine, LocalEngine

    if cluster is None:
        return LocalEngine(jobs or cores())
    if jobs is not None:
        raise InputError("--jobs is of own worker processes and --cluster of a scheduler's; give one of them")
    engine = ClusterEngine(cluster)
    engine.check()
    return engine


def placed(
    spacing: float | None, set_back: float | None, height: float | None, vehicles: int | None
) -> tuple[PlacementSettings, DemandSettings]:
    """Where poles stand and how much traffic is made, by the arguments."""
    from isacsim.scenarios.demand import DemandSettings
    from isacsim.scenarios.site_placement import PlacementSettings
    from isacsim.settings import checked

    places = {"spacing_m": spacing, "set_back_m": set_back, "height_m": height}
    given = {name: value for name, value in places.items() if value is not None}
    placement = checked(PlacementSettings, given, "arguments")
    return placement, checked(DemandSettings, {} if vehicles is None else {"vehicles": vehicles}, "arguments")


def cores() -> int:
    """Return how many processor cores this process may use, its affinity and the container's limit considered."""
    from dask.system import cpu_count

    return int(cpu_count())
