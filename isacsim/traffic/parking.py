"""Stops beside the road last as long as their duration says."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def let_stops_last(sumo: Any, vehicles: Iterable[str], step_s: float) -> None:
    """Give vehicles that have just stopped beside the road (`parking="true"`, a parking area) their whole stop.

    SUMO 1.28 counts a whole action step of such a stop in every step: with steps of 10 ms and action steps of 0.1 s, a
    stop of 30 s ends after 3 s, and one until a given time ends after a tenth of the time that is left. What is left of
    it when it begins is therefore set to as many action steps as steps are meant.

    sumo: the running libsumo module. step_s: of the simulation, s.
    """
    for vehicle in vehicles:
        longer = sumo.vehicle.getActionStepLength(vehicle) / step_s
        left_s = sumo.vehicle.getStops(vehicle, 1)[0].duration
        if longer > 1.0 and left_s > 0.0:
            sumo.vehicle.setStopParameter(vehicle, 0, "duration", f"{left_s * longer:.3f}")
