"""What SUMO does not get of a scenario is reported once: options of its configuration, and parts of its files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.log import MOST_NAMED
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study


class Loud(ScriptedSource):
    """`road` sets steps and makes SUMO write files, `quiet` does not."""

    def load(self, where: str) -> Scenario:
        scenario = super().load(where)
        if scenario.name != "road":
            return scenario
        parts = tuple(f"edgeData in {number}.add.xml" for number in range(MOST_NAMED + 2))
        return replace(scenario, overridden=("fcd-output", "step-length"), removed=parts)


def test_what_is_withheld_is_reported_once(tmp_path: Path) -> None:
    study = small_study(scenarios=["road", "quiet"], seeds={"first": 1, "last": 2})
    feedback = RecordedFeedback()
    dataset = generate(study, tmp_path / "data", InlineEngine(), feedback, source=Loud(tmp_path))
    assert len(dataset.meta.shards) == 4
    named = ", ".join(f"edgeData in {number}.add.xml" for number in range(MOST_NAMED))
    assert feedback.messages == [
        "road: these options of its configuration are not passed to SUMO: fcd-output, step-length",
        f"road: left out, because it writes files or is in none of SUMO's schemas: {named}, and 2 more",
    ]
