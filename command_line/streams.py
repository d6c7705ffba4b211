"""`generate --streams` and `inspect` of what it makes: from arguments to what the console shows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.progress import print_line
from isac_cosim.command_line import output
from isac_cosim.command_line.generation import draw_roads

if TYPE_CHECKING:
    from isac_cosim.base.feedback import Feedback
    from isac_cosim.base.workers.engine import Engine
    from isac_cosim.labeling.generation.settings import DatasetStudy
    from isac_cosim.labeling.streams.dataset import Streams


def generate_and_show(
    study: DatasetStudy, out: Path, engine: Engine, feedback: Feedback, console: Console
) -> dict[str, Any]:
    """Generate streams, after a line that says what that takes, and show them. Returns what `--json` prints."""
    from isac_cosim.labeling.streams.cost_estimate import estimate
    from isac_cosim.labeling.streams.generate import generate_streams

    if (cost := estimate(study)) is not None:
        print_line(console, cost.text)
    streams = generate_streams(study, out, engine, feedback)
    draw_roads(study, out, console)
    return show_streams(streams, console)


def inspect_and_show(folder: Path, verify: bool, console: Console) -> dict[str, Any]:
    """Show what is in a folder of streams. Returns what `--json` prints."""
    from isac_cosim.labeling.streams.dataset import Streams

    streams = Streams.open(folder)
    if verify:
        streams.verify()
    return {**show_streams(streams, console), "verified": verify}


def show_streams(streams: Streams, console: Console) -> dict[str, Any]:
    """Show what is in streams, and warn of what is missing. Returns its summary."""
    from isac_cosim.labeling.streams.dataset import show, summary

    content = summary(streams)
    show(content, console)
    if not content["vehicle_hours"]:
        output.warn("no vehicle was watched: none had a connected leader within range in view of two sites")
    return content
