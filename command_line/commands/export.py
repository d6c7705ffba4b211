"""The command `export`."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Annotated, Any, cast

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
        "export data --episode motorway-3 --from 60 --to 90 --mcap -o scene",
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
    mcap: Annotated[
        bool, typer.Option("--mcap", help="As a scene for Foxglove: vehicles, paths, sites and events (extra mcap).")
    ] = False,
    from_s: Annotated[
        float | None, typer.Option("--from", metavar="S", help="With --mcap, the stretch's first instant, s.")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", metavar="S", help="With --mcap, the stretch's last instant, s.")
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            min=0.001, max=60.0, metavar="S", help="Time between the states of an episode, s. Default: {export_step_s}."
        ),
    ] = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Write an episode or a sample of a dataset for other programs: SUMO, spreadsheets, statistics, Foxglove."""
    console = output.console_of(quiet)
    forms = {"fcd": fcd, "csv": csv, "mcap": mcap}
    if sum(forms.values()) != 1:
        raise InputError("export writes one form: give either --fcd, --csv or --mcap")
    if (episode is None) == (sample is None):
        raise InputError("export writes an episode or a sample: give either --episode SCENARIO-SEED or --sample ID")
    of_episode = {"--fcd": fcd, "--step": step is not None, "--from": from_s is not None, "--to": to_s is not None}
    if sample is not None and (given := [name for name, is_given in of_episode.items() if is_given]):
        raise InputError(f"{given[0]} applies to an episode: give --episode in place of --sample")
    span_s = -inf if from_s is None else from_s, inf if to_s is None else to_s
    if span_s != (-inf, inf) and not mcap:
        raise InputError("--from and --to apply to --mcap: the other forms hold the whole episode")
    if not span_s[0] < span_s[1]:
        raise InputError(f"--from {span_s[0]:g} --to {span_s[1]:g}: the stretch ends before it begins")
    form = next(name for name, is_given in forms.items() if is_given)
    output.print_json(as_json, _export_and_show(dataset, out, episode, sample, form, step, span_s, console))


def _export_and_show(
    folder: Path,
    out: Path,
    episode: str | None,
    sample: str | None,
    form: str,
    step_s: float | None,
    span_s: tuple[float, float],
    console: Any,
) -> dict[str, Any]:
    """Write what was asked for, and say what it is. Returns what `--json` prints."""
    from isac_cosim.base.progress import print_line
    from isac_cosim.base.workers.engine import LocalEngine
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.labeling.export.exporting import STEP_S, Form, export_episode, export_sample
    from isac_cosim.labeling.export.floating_car_data import CONFIG_FILE

    dataset = Dataset.open(folder)
    if sample is not None:
        done = export_sample(dataset, sample, out, "mcap" if form == "mcap" else "csv")
        print_line(console, f"{out}: {sample}, {done.states} instants")
    else:
        feedback = output.feedback_of(console)
        done = export_episode(
            dataset, str(episode), cast("Form", form), out, LocalEngine(1), step_s or STEP_S, feedback, span_s
        )
        print_line(console, f"{out}: {done.vehicles} vehicles, {done.states} states, {done.samples} samples")
        if done.left_out:
            print_line(console, f"{done.left_out} vehicles that collided or teleported are not in it")
        if form == "fcd":
            print_line(console, f"sumo-gui -c {out / CONFIG_FILE} replays it")
    counts = {"states": done.states, "samples": done.samples, "vehicles": done.vehicles, "left_out": done.left_out}
    return {"folder": str(out), **counts}
