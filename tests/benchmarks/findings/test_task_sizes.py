"""What tasks send through a scheduler: little, and no more for a dataset of many shards."""

from __future__ import annotations

import pytest

from isac_cosim.benchmarks.findings import task_sizes


def test_tasks_are_small_and_do_not_list_all_shards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_sizes, "SEEDS", 4)
    few = task_sizes.run()
    monkeypatch.setattr(task_sizes, "SEEDS", 400)
    many = task_sizes.run()
    assert list(few) == list(many)
    for command in ("generate", "sense", "evaluate --traffic"):
        assert abs(many[command]["task_bytes"] - few[command]["task_bytes"]) < 100
    # A training is told the seeds of each side.
    for command in ("run, a training of a sweep", "reproduce, a training"):
        assert many[command]["task_bytes"] - few[command]["task_bytes"] < 400 * 20
    assert all(0 < sizes["task_bytes"] < 20_000 for sizes in many.values())
