"""The command `clips`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isac_cosim.base.errors import InputError
from isac_cosim.command_line import options as opt
from isac_cosim.command_line import output
from isac_cosim.command_line.help import HelpfulCommand, examples

if TYPE_CHECKING:
    from isac_cosim.models.data.clips import Extraction

CUT = re.compile(r"(\d{1,5})x(\d{1,5})(?:\+(\d{1,5})\+(\d{1,5}))?", re.ASCII)


def add_clips(app: typer.Typer) -> None:
    """Add the command to those of the tool."""
    lines = (
        "clips brain4cars_data -o clips --complete-only",
        "clips brain4cars_data -o clips --road-weights resnet18.pth --driver-weights mobilefacenet.pth",
    )
    app.command(cls=HelpfulCommand, epilog=examples(*lines))(clips)


def clips(
    videos: Annotated[Path, typer.Argument(metavar="VIDEOS", help="Folder of Brain4Cars, or one with a clips.csv.")],
    out: opt.Out,
    road_weights: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Weights of a ResNet-18, as of torchvision. Default: random, a floor."),
    ] = None,
    driver_weights: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Weights of a MobileFaceNet, as of InsightFace_Pytorch. Default: random, a floor."
        ),
    ] = None,
    driver_cut: Annotated[
        str | None,
        typer.Option(
            metavar="WxH[+X+Y]",
            help="Pixels of the driver's view to use, from X, Y on, or in the middle. Default: 900x800.",
        ),
    ] = None,
    complete_only: Annotated[
        bool,
        typer.Option(
            "--complete-only",
            help="Leave out events without a view or speeds, shorter than 5 s, or with views of different lengths.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Seed of random weights and projections.")] = 0,
    jobs: opt.Jobs = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Make feature files for `reproduce castformer --clips` of pairs of videos, as of Brain4Cars (extra video).

    Repeat the command to continue an interrupted one.
    """
    from isac_cosim.models.video.extraction import Weights, extract_clips
    from isac_cosim.models.video.settings import VideoSettings

    given: dict[str, Any] = {"seed": seed, **_cut(driver_cut)}
    engine, feedback = opt.engine_of(jobs, None, out), output.feedback_of(output.console_of(quiet))
    weights = Weights(road_weights, driver_weights)
    done = extract_clips(videos, out, VideoSettings(**given), weights, engine, feedback, complete_only=complete_only)
    output.print_json(as_json, _shown(done, out, quiet))


def _cut(text: str | None) -> dict[str, Any]:
    """Return the settings that say what is cut out of the driver's view."""
    if text is None:
        return {}
    found = CUT.fullmatch(text)
    numbers = [int(number) for number in found.groups() if number is not None] if found else []
    if not numbers or min(numbers[:2]) < 1 or max(numbers) > 10_000:
        raise InputError(f"--driver-cut {text}: give width and height as 900x800, or 900x800+500+100 with a corner")
    return {"driver_cut": tuple(numbers[:2]), "driver_corner": tuple(numbers[2:]) or None}


def _shown(done: Extraction, out: Path, quiet: bool) -> dict[str, Any]:
    """Show what was made. Returns what `--json` prints."""
    from isac_cosim.base.progress import print_line

    console = output.console_of(quiet)
    for name, reason in done.left_out.items():
        print_line(console, f"left out: {name}: {reason}")
    for view in done.random:
        network = {"road": "ResNet-18", "driver": "MobileFaceNet"}[view]
        output.warn(f"features of the {view} are of a {network} with random weights, a floor; give --{view}-weights")
    print_line(console, f"{out}: {len(done.clips)} clips, {len(done.left_out)} pairs left out")
    return {"folder": str(out), "clips": len(done.clips), "left_out": done.left_out, "random": done.random}
