"""The commands that are not in `cosim.py`, which is the table of contents of the others."""

from __future__ import annotations

import typer

from isac_cosim.command_line.commands.clips import add_clips
from isac_cosim.command_line.commands.describe import add_describe
from isac_cosim.command_line.commands.export import add_export
from isac_cosim.command_line.commands.road_network import network_app


def add_commands(app: typer.Typer) -> None:
    """Add `clips`, `describe`, `export` and the commands of `network`."""
    add_clips(app)
    add_describe(app)
    add_export(app)
    app.add_typer(network_app, name="network")
