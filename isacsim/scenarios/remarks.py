"""What the author of a scenario should know before it is used: what is put right, and what is not simulated."""

from __future__ import annotations

from isac_cosim.isacsim.scenarios.demand_order import read_demand
from isac_cosim.isacsim.scenarios.scenario import Elevation, Scenario
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full


def remarks(scenario: Scenario) -> list[str]:
    """Return the remarks on a scenario, one line each."""
    lines = []
    for file in scenario.demand:
        content = read_demand(file, scenario.begin_s)
        if content.is_put_in_order:
            lines.append(
                f"{file}: is not sorted by departure: SUMO would leave out {len(content.late)} of its "
                f"{content.departures} vehicles and flows, the first {content.late[0]!r}; it is given a sorted copy"
            )
    if scenario.elevation is not None:
        lines.append(f"{scenario.network}: {_flattened(scenario.elevation)}")
    return lines


def _flattened(elevation: Elevation) -> str:
    """Return what is not simulated of a network's heights."""
    low, high = (in_full(round(value, 1)) for value in (elevation.low_m, elevation.high_m))
    return (
        f"{elevation.edges} of {elevation.of} edges leave the median height by more than 1 m ({low} to {high} m): the "
        "network is taken as flat, and sites stand at their height above it"
    )
