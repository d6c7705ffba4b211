"""A night of small batches: many short episodes of the bundled motorway, by the workers that the command uses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isacsim.settings import checked
from labeling.generation.engine import LocalEngine
from labeling.generation.generate import generate
from labeling.generation.log import LOG_FILE
from labeling.generation.settings import DatasetStudy

EPISODES = 1000
SHORT = {"run_in_s": 30.0, "duration_s": 20.0}


@pytest.mark.slow
def test_a_thousand_episodes_lose_none(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Each ends once, made, and the dataset is what the log says it is. A quarter of an hour on two cores."""
    study = checked(DatasetStudy, {"seeds": {"first": 1, "last": EPISODES}, "traffic": SHORT}, "test")
    made = generate(study, tmp_path / "data", LocalEngine(2))
    entries = [json.loads(line) for line in (made.path / LOG_FILE).read_text().splitlines()]
    print(f"{len(entries)} episodes, {sum(each['retries'] for each in entries)} retries, {made.meta.samples} samples")
    assert sorted(each["seed"] for each in entries) == list(range(1, EPISODES + 1))
    assert [each for each in entries if each["outcome"] != "made"] == []
    assert made.meta.lost == ()
    assert [shard.episode.seed for shard in made.meta.shards] == list(range(1, EPISODES + 1))
    assert {shard.episode.seed: shard.samples for shard in made.meta.shards} == {
        each["seed"]: each["samples"] for each in entries
    }
    assert made.meta.samples > EPISODES // 10
    assert cosim.main(["inspect", str(made.path), "--verify", "--json", "--quiet"]) == 0
    found = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert (found["verified"], found["digest"], found["lost"]) == (True, made.digest, [])
