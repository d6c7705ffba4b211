"""The split of a scene's loss: the same records in every way of knowing them, resumed, and counted per seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.benchmarks.findings.figures.pages import printed_tables
from isac_cosim.benchmarks.findings.sensing import loss_split
from isac_cosim.benchmarks.findings.sensing.loss_split import ENDS, SINGLE, TRUTH, Counts, Split, accuracy, table

STUDY = {
    "scenarios": ["straight_road"],
    "source": "kinematic",
    "sensing": {"channel": {"kind": "link"}},
    "kinematics": {"per_class": 1, "following_scenes": 0, "lead_s": 5},
    "record": {"tv_rate_hz": 50.0, "uv_rate_hz": 25.0, "duration_s": 5.0, "before_onset_s": 2.6},
    "selection": {"per_class": 1, "following": 0},
}
SCENES = {"points, tracks": {"bodies": "points", "fixes_hz": "5"}}


@pytest.mark.slow
def test_every_way_answers_the_same_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loss_split, "TRAINING", {"rule": {}})
    split = Split(tmp_path, (1, 2, 3), STUDY, SCENES, parts=("single: velocity",))
    records = split.records(split.sense())
    assert list(records) == [TRUTH, SINGLE, "points, tracks", "single: velocity"]
    first = records[TRUTH]
    assert 3 <= len(first) <= 18
    for of in records.values():
        assert of.table["sample_id"].tolist() == first.table["sample_id"].tolist()
        assert np.array_equal(of.uv, first.uv)
    for way, of in records.items():
        differ = np.abs(np.asarray(of.tv) - np.asarray(first.tv)).max(axis=(0, 2)) > 0
        assert differ.tolist() == {TRUTH: [False] * 6, "single: velocity": [False] * 2 + [True] * 2 + [False] * 2}.get(
            way, [True] * 6
        )
    answers = split.answers(records)
    of_truth = answers["rule"][TRUTH]
    # The records begin 2.6 s before onset, so no window of 2.2 s ends 0.75 s before it.
    assert {row[1] for row in of_truth} == {end for ends in ENDS.values() for end in ends if end > -0.75}
    assert {row[0] for row in of_truth} == set(first.groups)
    assert sum(row[3] for row in of_truth if row[1] == 0.0) == len(first)
    printed = printed_tables("\n".join(table(answers)))["Rule of the road"].splitlines()
    assert [line.split(" | ")[0] for line in printed[4:]] == [f"| {way}" for way in records]

    def never(*_: Any) -> Counts:
        raise AssertionError("trained again")

    monkeypatch.setattr(loss_split, "cross_validated", never)
    assert split.answers(records) == answers


@pytest.mark.slow
def test_several_workers_sense_and_train_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alone = Split(tmp_path / "alone", (1, 2, 3), STUDY, SCENES)
    beside = replace(alone, folder=tmp_path / "beside", engine=LocalEngine(2))
    one, other = (
        {way: [of.digest for of in known] for way, known in split.sense().items()} for split in (alone, beside)
    )
    assert one == other
    monkeypatch.setattr(loss_split, "TRAINING", {"rule": loss_split.TRAINING["rule"]})
    answers = [split.answers(split.records(split.sense())) for split in (alone, beside)]
    assert answers[0] == answers[1]


def test_accuracy_and_its_paired_interval_are_by_seed() -> None:
    """Against the textbook's interval of a mean of equally large groups."""
    right, other = np.array([6, 9, 4, 8]), np.array([5, 9, 5, 5])
    first, second = ([[f"road-{k}", 0.0, "natural", 10, int(n)] for k, n in enumerate(of)] for of in (right, other))
    every = np.ones(4, dtype=bool)
    quantile = 3.182446  # of Student's t, 97.5 %, 3 degrees of freedom
    value, half = accuracy(first, every)
    assert (value, half) == pytest.approx((0.675, quantile * np.std(right / 10, ddof=1) / 2), rel=1e-5)
    lost, wide = accuracy(first, every, second)
    assert (lost, wide) == pytest.approx((0.075, quantile * np.std((right - other) / 10, ddof=1) / 2), rel=1e-5)
    with pytest.raises(ValueError, match="other windows"):
        accuracy(first, every, second[::-1])
