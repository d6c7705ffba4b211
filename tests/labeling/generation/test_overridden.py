"""What of a user's configuration is overridden is told once a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from isacsim.scenarios.scenario import Scenario
from labeling.generation.generate import generate
from tests.support.scripted import InlineEngine, ScriptedSource, small_study


class Loud(ScriptedSource):
    """Its scenario `road` asks for steps and outputs of its own, `quiet` for nothing."""

    def load(self, where: str) -> Scenario:
        scenario = super().load(where)
        return replace(scenario, overridden=("fcd-output", "step-length") if scenario.name == "road" else ())


def test_overridden_options_are_told_once(tmp_path: Path) -> None:
    told: list[tuple[str, Sequence[str]]] = []
    study = small_study(scenarios=["road", "quiet"], seeds={"first": 1, "last": 2})
    made = generate(
        study, tmp_path / "data", InlineEngine(), source=Loud(tmp_path), tell=lambda *line: told.append(line)
    )
    assert len(made.meta.shards) == 4
    assert told == [("road", ("fcd-output", "step-length"))]
