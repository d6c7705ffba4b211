"""Whether the true motion of a dataset does what its labels say, told from the dataset alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cosim
from isac_cosim.labeling.dataset.dataset import Dataset, Episode, Meta, Sample, ScenarioMeta, write_meta, write_shard
from isac_cosim.labeling.dataset.label_truth import label_truth
from isac_cosim.labeling.dataset.summary import faults, summary
from isac_cosim.labeling.intentions import Intention

RATE_HZ, DURATION_S, ONSET_S = 100.0, 5.0, 2.6
TIMES = np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ


def truth(along: np.ndarray, heading: float = 0.7, speed: float = 20.0, across: np.ndarray | float = 0.0) -> np.ndarray:
    """Return true states with an acceleration along the way and across it, m/s2, (6, S)."""
    across = np.broadcast_to(across, len(TIMES))
    v = np.stack([speed + np.cumsum(along) / RATE_HZ, np.cumsum(across) / RATE_HZ])
    x = np.cumsum(v, axis=1) / RATE_HZ
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    return np.concatenate([turn @ part for part in (x, v, np.stack([along, across]))])


def brake(level: float, commit_s: float = 3.0) -> np.ndarray:
    """Return an acceleration that falls evenly, to `level` at a commit and on to twice that, m/s2."""
    return np.asarray(np.interp(TIMES, [commit_s - 0.5, commit_s, commit_s + 0.5], [0.0, level, 2 * level]))


def dataset(
    folder: Path, samples: list[tuple[Intention, np.ndarray]], study: dict[str, object] | None = None
) -> Dataset:
    """Return a dataset of such intentions and true states, each with its onset at 2.6 s and its commit at 3 s."""
    (folder / "shards").mkdir(parents=True)
    length = len(TIMES)
    rows = [
        Sample(
            f"road-1-{k}", "road", 1, "sumo", f"tv{k}", "uv", intention, "natural", 100.0, 102.6, 103.0, 105.0,
            "isac", 5.0, 4, *(states.astype(np.float32),) * 3, x0=20_000.0, y0=100.0,
        )
        for k, (intention, states) in enumerate(samples)
    ]  # fmt: skip
    shard = write_shard(folder / "shards", rows, Episode(scenario="road", seed=1), length, length)
    scenario = ScenarioMeta(name="road", source="road", sha256="0" * 64, origin=(0.0, 0.0), sites=())
    meta = Meta(
        complete=True, fingerprint="f", tv_rate_hz=RATE_HZ, uv_rate_hz=RATE_HZ, duration_s=DURATION_S,
        study=study or {}, versions={}, scenarios=(scenario,), shards=(shard,),
    )  # fmt: skip
    write_meta(folder, meta)
    return Dataset.open(folder)


STEADY = np.zeros(len(TIMES))
AGREES = [
    (Intention.HARD_BRAKE, truth(brake(-4.0))),
    (Intention.HARD_ACCEL, truth(brake(2.5))),
    (Intention.FOLLOWING, truth(STEADY + 1.9)),
    (Intention.LEFT_LANE_CHANGE, truth(STEADY, across=0.5 * np.sin(TIMES))),
    # A brake before the event, and a short one within it: neither is an event of its own.
    (Intention.OVERTAKE, truth(np.where(TIMES < 1.5, -6.0, 0.0), speed=40.0)),
    (Intention.EVASIVE_SWERVE, truth(np.where(np.abs(TIMES - 3.5) < 0.15, -7.0, 0.0))),
]


def test_truth_that_does_what_the_label_says_agrees(tmp_path: Path) -> None:
    compared = label_truth(dataset(tmp_path / "data", AGREES))
    assert compared is not None
    assert (compared["compared"], compared["share"], compared["limit_mps2"]) == (len(AGREES), 0.0, 0.5)
    assert compared["worst_mps2"] < 0.15


@pytest.mark.parametrize(
    ("intention", "states", "difference"),
    [
        (Intention.HARD_BRAKE, truth(brake(-1.4)), 2.6),
        (Intention.HARD_BRAKE, truth(brake(-5.5)), 1.5),
        (Intention.HARD_ACCEL, truth(brake(1.5)), 1.0),
        (Intention.FOLLOWING, truth(np.where(np.abs(TIMES - 2.0) < 0.3, -3.0, 0.0)), 1.0),
        (Intention.LEFT_LANE_CHANGE, truth(np.where(TIMES > 3.5, -5.0, 0.0)), 1.0),
        (Intention.RIGHT_LANE_CHANGE, truth(np.where(TIMES > 3.0, 3.5, 0.0)), 1.0),
    ],
)
def test_truth_that_does_something_else_is_counted(
    tmp_path: Path, intention: Intention, states: np.ndarray, difference: float
) -> None:
    compared = label_truth(dataset(tmp_path / "data", [*AGREES, (intention, states)]))
    assert compared is not None
    assert compared["share"] == pytest.approx(1 / (len(AGREES) + 1), abs=1e-4)
    assert compared["worst_mps2"] == pytest.approx(difference, abs=0.1)
    assert compared["sample_id"] == f"road-1-{len(AGREES)}"


def test_inspect_says_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    wrong = dataset(tmp_path / "data", [*AGREES, (Intention.HARD_BRAKE, truth(brake(-1.4)))])
    assert cosim.main(["inspect", str(wrong.path), "--json"]) == 0
    printed = capfd.readouterr()
    compared = json.loads(printed.out)["labels_and_truth"]
    assert compared == label_truth(wrong)
    assert "labels_and_truth: compared 7" in printed.err
    assert "in 14.3% of 7 samples, the true acceleration differs" in " ".join(printed.err.split())
    right = dataset(tmp_path / "right", AGREES)
    assert not any("true acceleration" in line for line in faults(summary(right)))


def test_the_definitions_of_the_study_hold(tmp_path: Path) -> None:
    labels = {"preset": "own", "hard_brake": {"threshold_mps2": 3.0}, "following": {"acceleration_mps2": None}}
    samples = [(Intention.HARD_BRAKE, truth(brake(-3.0))), (Intention.FOLLOWING, truth(STEADY - 3.5))]
    compared = label_truth(dataset(tmp_path / "data", samples, {"labels": labels}))
    assert compared is not None
    assert compared["share"] == 0.0


def test_without_samples_or_definitions_nothing_is_compared(tmp_path: Path) -> None:
    assert label_truth(dataset(tmp_path / "empty", [])) is None
    unknown = {"labels": {"preset": "own", "detectors": {"of_another_package": {}}}}
    assert label_truth(dataset(tmp_path / "other", AGREES, unknown)) is None
