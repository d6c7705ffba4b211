"""A night of small batches: many short episodes of the bundled motorway, by the workers that the command uses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.log import LOG_FILE
from isac_cosim.labeling.generation.settings import DatasetStudy

EPISODES = 1000
SHORT = {"run_in_s": 30.0, "duration_s": 20.0}


@pytest.mark.slow
def test_a_thousand_episodes_lose_none(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Each ends once, made, and the dataset is what the log says it is. A quarter of an hour on two cores."""
    study = checked(DatasetStudy, {"seeds": {"first": 1, "last": EPISODES}, "traffic": SHORT}, "test")
    dataset = generate(study, tmp_path / "data", LocalEngine(2))
    entries = [json.loads(line) for line in (dataset.path / LOG_FILE).read_text().splitlines()]
    print(
        f"{len(entries)} episodes, {sum(entry['retries'] for entry in entries)} retries, {dataset.meta.samples} samples"
    )
    assert sorted(entry["seed"] for entry in entries) == list(range(1, EPISODES + 1))
    assert [entry for entry in entries if entry["outcome"] != "made"] == []
    assert dataset.meta.lost == ()
    assert [shard.episode.seed for shard in dataset.meta.shards] == list(range(1, EPISODES + 1))
    assert {shard.episode.seed: shard.samples for shard in dataset.meta.shards} == {
        entry["seed"]: entry["samples"] for entry in entries
    }
    assert dataset.meta.samples > EPISODES // 10
    assert cosim.main(["inspect", str(dataset.path), "--verify", "--json", "--quiet"]) == 0
    summary = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert (summary["verified"], summary["digest"], summary["lost"]) == (True, dataset.digest, [])
