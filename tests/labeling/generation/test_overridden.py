"""The options of a user's configuration that are ignored are reported once per scenario."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.labeling.generation.generate import generate
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study


class Loud(ScriptedSource):
    """The configuration of `road` sets steps and outputs, that of `quiet` does not."""

    def load(self, where: str) -> Scenario:
        scenario = super().load(where)
        return replace(scenario, overridden=("fcd-output", "step-length") if scenario.name == "road" else ())


def test_overridden_options_are_reported_once(tmp_path: Path) -> None:
    study = small_study(scenarios=["road", "quiet"], seeds={"first": 1, "last": 2})
    feedback = RecordedFeedback()
    dataset = generate(study, tmp_path / "data", InlineEngine(), feedback, source=Loud(tmp_path))
    assert len(dataset.meta.shards) == 4
    assert feedback.messages == [
        "road: these options of its configuration are not passed to SUMO: fcd-output, step-length"
    ]
