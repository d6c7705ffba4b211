"""`generate` with samples: the dataset, and for a file of trajectories a picture of its road beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.progress import print_line
from isac_cosim.base.workers.engine import Engine
from isac_cosim.command_line import output

if TYPE_CHECKING:
    from isac_cosim.labeling.generation.settings import DatasetStudy


def generate_and_show(
    study: DatasetStudy, out: Path, engine: Engine, feedback: Feedback, console: Console
) -> dict[str, Any]:
    """Generate a dataset and show what is in it. Returns what `--json` prints."""
    from isac_cosim.labeling.generation.generate import generate

    dataset = generate(study, out, engine, feedback)
    draw_roads(study, out, console)
    return output.show_dataset(dataset, console)


def draw_roads(study: DatasetStudy, out: Path, console: Console) -> None:
    """Draw the roads of files of trajectories beside what is made of them, where they are not yet, and say where."""
    from isac_cosim.evaluation.report.roads.picture import draw_road
    from isac_cosim.isacsim.scenarios.scenario import resolved
    from isac_cosim.isacsim.traffic.sources.recorded_files import FileSource, opened
    from isac_cosim.isacsim.traffic.sources.registry import motion_source
    from isac_cosim.labeling.dataset.dataset import ROADS

    source = motion_source(study)
    if isinstance(source, FileSource):
        for where in study.scenarios:
            scenario = source.load(resolved(where))
            path = out / ROADS / f"{scenario.name}.png"
            if not path.exists():
                draw_road(scenario, opened(source, scenario.demand[0]).observed, path)
            print_line(console, f"the road, its sites and the first vehicles: {path}")
