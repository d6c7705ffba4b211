"""What became of the demand in a simulation: who drove, who did not, and what SUMO said of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning


class TrafficFacts(Settings):
    """What became of the demand in one simulation.

    from_s, to_s: the recorded span of simulation time, s. vehicles: how many vehicles departed, run-in included.
    by_class: the same by SUMO vehicle class. discarded: how many vehicles SUMO gave up before they could depart.
    recorded: how many vehicles have a track. first_departure_s: where none has, when the first vehicle of the demand
    departs, s. warnings: SUMO's, by kind.
    """

    from_s: float
    to_s: float
    vehicles: int = Field(ge=0)
    by_class: dict[str, int] = Field(default_factory=dict)
    discarded: int = Field(0, ge=0)
    recorded: int = Field(ge=0)
    first_departure_s: float | None = None
    warnings: tuple[SumoWarning, ...] = ()

    @property
    def warning_count(self) -> int:
        """How many warnings SUMO gave."""
        return sum(warning.count for warning in self.warnings)


def discarded(sumo: Any, departed: Mapping[str, object]) -> int:
    """Return how many vehicles SUMO has given up before they could depart, as after `max-depart-delay`.

    sumo: the running libsumo module. departed: the vehicles that have departed so far.
    """
    loaded, inserted = (
        int(sumo.simulation.getParameter("", f"stats.vehicles.{name}")) for name in ("loaded", "inserted")
    )
    waiting = sum(name not in departed for name in sumo.vehicle.getLoadedIDList())
    return max(0, loaded - inserted - waiting)
