"""What an environment is made of: its traffic, who predicts, and what an agent may do."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.sensing.sensors import DEFAULT


def _scenario(value: Any) -> Any:
    """A scenario's path made absolute, because a process of its own may begin elsewhere."""
    return resolved(os.fspath(value)) if isinstance(value, str | os.PathLike) else value


def _folder(value: Any) -> Any:
    """A folder's path made absolute."""
    return str(Path(value).resolve()) if isinstance(value, str | os.PathLike) else value


class EnvironmentSettings(Settings):
    """The arguments of `gymnasium.make`."""

    scenario: Annotated[str, BeforeValidator(_scenario)] = Field("motorway", description="bundled name or path")
    run: Annotated[str | None, BeforeValidator(_folder)] = Field(
        None, description="folder of a trained predictor; None: the network senses, but predicts nothing"
    )
    duration_s: float = Field(60.0, gt=0.0, le=1e6, description="length of the simulation after the run-in, s")
    run_in_s: float = Field(90.0, ge=0.0, le=1e6, description="time simulated before, s")
    every_s: float = Field(1.0, gt=0.0, le=60.0, description="time between two actions, s")
    slots: int = Field(8, ge=1, le=1000, description="most vehicles that are observed and can be advised at once")
    advisory_cost: float = Field(0.01, ge=0.0, description="what sending an advisory costs, in the unit of the reward")
    natural: bool = Field(False, description="drivers are left alone")
    sensor: str = Field(DEFAULT, description="what senses the TVs: isac, radar, truth or an installed one")
    settings: ClosedLoopSettings = ClosedLoopSettings()
