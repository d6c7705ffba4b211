"""The commands `network import` and `network sites`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from isac_cosim.base.errors import InputError
from isac_cosim.command_line import options as opt
from isac_cosim.command_line import output
from isac_cosim.command_line.help import HelpfulCommand, examples

network_app = typer.Typer(help="Make a scenario from a map, or from a network without base-station sites.")


@network_app.command(
    "import",
    cls=HelpfulCommand,
    epilog=examples("network import town.osm.gz -o town --box 9.7,52.3,9.8,52.4"),
)
def network_import(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="OpenStreetMap file: .osm, .osm.xml, or gzipped.")],
    out: opt.Out,
    box: Annotated[
        str | None, typer.Option(metavar="W,S,E,N", help="Part of the map: west, south, east, north, degrees.")
    ] = None,
    left_hand: Annotated[bool, typer.Option("--left-hand", help="Let traffic keep left.")] = False,
    spacing: opt.Spacing = None,
    set_back: opt.SetBack = None,
    height: opt.Height = None,
    vehicles: opt.Vehicles = None,
    seed: opt.DemandSeed = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Make a scenario from a map: network, demand, and sites along the roads."""
    from isac_cosim.command_line.arguments import box_of
    from isac_cosim.isacsim.scenarios.making import import_map

    part = None if box is None else box_of(box)
    placement = opt.placement_of(spacing, set_back, height, vehicles)
    new_scenario = import_map(source, out, part, *placement, seed or 0, lefthand=left_hand)
    output.print_json(as_json, output.show_scenario(new_scenario, str(source), output.console_of(quiet)))


@network_app.command(
    "sites",
    cls=HelpfulCommand,
    epilog=examples("network sites my_network.net.xml -o my_scenario --spacing 150"),
)
def network_sites(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="Folder, .sumocfg or .net.xml.")],
    out: opt.Out,
    spacing: opt.Spacing = None,
    set_back: opt.SetBack = None,
    height: opt.Height = None,
    vehicles: opt.Vehicles = None,
    seed: opt.DemandSeed = None,
    as_json: opt.AsJson = False,
    quiet: opt.Quiet = False,
) -> None:
    """Make a scenario with sites along the roads of a network, and demand where it has none.

    Nothing is written beside the original.
    """
    from isac_cosim.isacsim.scenarios.making import add_sites, has_own_demand
    from isac_cosim.isacsim.scenarios.scenario import load_without_sites

    placement = opt.placement_of(spacing, set_back, height, vehicles)
    of_demand = {"--vehicles": vehicles, "--seed": seed}
    given = [option for option, value in of_demand.items() if value is not None]
    if given and has_own_demand(load_without_sites(scenario)):
        raise InputError(f"{given[0]} applies to demand that is made, and {scenario} has its own: remove the option")
    new_scenario = add_sites(scenario, out, *placement, seed or 0)
    output.print_json(as_json, output.show_scenario(new_scenario, scenario, output.console_of(quiet)))
