"""One simulation a process: libsumo holds a single one, and replaces it without a word when another is started."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from isac_cosim.base.errors import InputError, RunError

MARK = "error-log"
"""The option of SUMO that tells simulations apart: each has a log file of its own."""


class TrafficError(RunError):
    """SUMO failed during a simulation. The message gives the reason in one line."""


def simulation_runs() -> bool:
    """Return whether libsumo holds a simulation in this process, whoever started it. It is not loaded for that."""
    libsumo = sys.modules.get("libsumo")
    return libsumo is not None and bool(libsumo.simulation.isLoaded())


def refuse_a_second(scenario: str) -> None:
    """Raise InputError where a simulation runs already. scenario: name of the one that would be started."""
    if simulation_runs():
        raise InputError(
            f"scenario {scenario}: another simulation is open in this process, and libsumo holds one at a time: close "
            "that one first (an environment by its close()), or run one of the two in a process of its own"
        )


@dataclass(frozen=True)
class HeldSimulation:
    """The simulation that a session has started, for as long as libsumo holds it. sumo: the libsumo module."""

    sumo: Any
    mark: str

    @classmethod
    def present(cls, sumo: Any) -> HeldSimulation:
        """Return the simulation that libsumo holds now."""
        return cls(sumo, sumo.simulation.getOption(MARK))

    def is_held(self) -> bool:
        """Return whether libsumo still holds this simulation, and no other."""
        simulation = self.sumo.simulation
        return bool(simulation.isLoaded() and simulation.getOption(MARK) == self.mark)

    def check(self, time_s: float, step_s: float) -> None:
        """Raise TrafficError where other code has ended or stepped this simulation. time_s: where it was left, s."""
        if not self.is_held() or abs(self.sumo.simulation.getTime() - time_s) > step_s / 2.0:
            raise TrafficError(
                "other code in this process has used libsumo, which ended or moved this simulation: begin it anew, and "
                "run one of the two in a process of its own"
            )

    def close(self) -> None:
        """End the simulation. One that other code has started since stays."""
        if self.is_held():
            self.sumo.close()
