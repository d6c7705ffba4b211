"""The command `describe`."""

from __future__ import annotations

from typing import Annotated

import typer

from isac_cosim.command_line import options as opt
from isac_cosim.command_line import output
from isac_cosim.command_line.help import HelpfulCommand, examples


def add_describe(app: typer.Typer) -> None:
    """Add the command to those of the tool."""
    lines = ("describe data", 'describe data --license CC-BY-4.0 --citation "A. Author, Traffic, 2026"')
    app.command(cls=HelpfulCommand, epilog=examples(*lines))(describe)


def describe(
    dataset: opt.DatasetFolder,
    license_: Annotated[
        str | None, typer.Option("--license", metavar="ID", help="Licence: an SPDX identifier, or a URL.")
    ] = None,
    citation: Annotated[str | None, typer.Option(metavar="TEXT", help="How to cite the dataset.")] = None,
    creator: Annotated[str | None, typer.Option(metavar="NAME", help="Who made it.")] = None,
    url: Annotated[str | None, typer.Option(metavar="URL", help="Where it is published.")] = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Write README.md and croissant.json of a dataset anew, with its licence and citation.

    What is not given stays as it was stated before.
    """
    from isac_cosim.base.progress import print_line
    from isac_cosim.base.settings import checked
    from isac_cosim.labeling.publication import describing
    from isac_cosim.labeling.publication.card import README_FILE
    from isac_cosim.labeling.publication.statement import Statement

    console = output.console_of(quiet)
    given = {"license": license_, "citation": citation, "creator": creator, "url": url}
    stated, written = describing.describe(dataset, checked(Statement, given, "arguments"))
    open_ = [name for name, value in stated if value is None]
    if not written:
        output.warn(f"{dataset / README_FILE}: is somebody's own and stays as it is")
    if open_:
        print_line(console, f"nobody has stated: {', '.join(open_)}; give --{open_[0]}")
    output.print_json(as_json, {"dataset": str(dataset), "readme": written, **stated.model_dump()})
