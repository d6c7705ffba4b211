"""The command `export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from isac_cosim.base.errors import InputError
from isac_cosim.command_line import options as opt
from isac_cosim.command_line import output
from isac_cosim.command_line.help import HelpfulCommand, examples


def add_export(app: typer.Typer) -> None:
    """Add the command to those of the tool."""
    lines = (
        "export data --episode motorway-3 --fcd -o replayed",
        "export data --episode motorway-3 --csv -o tables",
        "export data --sample motorway-3-0 --csv -o one_record",
    )
    app.command(cls=HelpfulCommand, epilog=examples(*lines))(export)


def export(
    dataset: opt.DatasetFolder,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write: a new or empty one.")],
    episode: Annotated[
        str | None, typer.Option(metavar="SCENARIO-SEED", help="All vehicles of an episode, which is simulated again.")
    ] = None,
    sample: Annotated[str | None, typer.Option(metavar="ID", help="The states of one sample.")] = None,
    fcd: Annotated[
        bool, typer.Option("--fcd", help="As floating car data, with all that sumo-gui needs to replay it.")
    ] = False,
    csv: Annotated[bool, typer.Option("--csv", help="As tables.")] = False,
    step: Annotated[
        float | None,
        typer.Option(
            min=0.001, max=60.0, metavar="S", help="Time between the states of an episode, s. Default: {export_step_s}."
        ),
    ] = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Write an episode or a sample of a dataset for other programs: SUMO, spreadsheets, statistics."""
    console = output.console_of(quiet)
    if fcd == csv:
        raise InputError("export writes one form: give either --fcd or --csv")
    if (episode is None) == (sample is None):
        raise InputError("export writes an episode or a sample: give either --episode SCENARIO-SEED or --sample ID")
    if sample is not None and (fcd or step is not None):
        raise InputError(f"{'--fcd' if fcd else '--step'} applies to an episode: give --episode in place of --sample")
    output.print_json(as_json, _export_and_show(dataset, out, episode, sample, fcd, step, console))


def _export_and_show(
    folder: Path, out: Path, episode: str | None, sample: str | None, fcd: bool, step_s: float | None, console: Any
) -> dict[str, Any]:
    """Write what was asked for, and say what it is. Returns what `--json` prints."""
    from isac_cosim.base.progress import print_line
    from isac_cosim.base.workers.engine import LocalEngine
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.labeling.export.exporting import STEP_S, export_episode, export_sample
    from isac_cosim.labeling.export.floating_car_data import CONFIG_FILE

    dataset = Dataset.open(folder)
    if sample is not None:
        done = export_sample(dataset, sample, out)
        print_line(console, f"{out}: {sample}, {done.states} instants")
    else:
        feedback = output.feedback_of(console)
        done = export_episode(
            dataset, str(episode), "fcd" if fcd else "csv", out, LocalEngine(1), step_s or STEP_S, feedback
        )
        print_line(console, f"{out}: {done.vehicles} vehicles, {done.states} states, {done.samples} samples")
        if done.left_out:
            print_line(console, f"{done.left_out} vehicles that collided or teleported are not in it")
        if fcd:
            print_line(console, f"sumo-gui -c {out / CONFIG_FILE} replays it")
    counts = {"states": done.states, "samples": done.samples, "vehicles": done.vehicles, "left_out": done.left_out}
    return {"folder": str(out), **counts}
