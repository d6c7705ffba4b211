"""Dropped pull-outs beside a dataset: stored and sensed like samples, and never among them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, Dataset
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.dataset.shard import ARRAYS, SCALARS
from isac_cosim.labeling.dataset.summary import summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing, resense
from isac_cosim.labeling.generation.selection import draw_of_pull_outs, select
from isac_cosim.labeling.generation.settings import DatasetStudy, SelectionSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.samples.candidates import Candidate
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, record, sweep, total
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

INLINE = InlineEngine()
ROAD = Road((Stretch(6000.0),))
PAIRS = 3


class PassingSource(ScriptedSource):
    """Three pull-outs in every episode: one passes and returns, one passes and stays, one does not pass."""

    def load(self, where: str) -> Scenario:
        return replace(super().load(where), lanes=ROAD.lanes())

    def record(self, scenario: Scenario, seed: int) -> Recording:
        drives = []
        for k in range(PAIRS):
            rng = stream("passing", seed, k)
            gain, at_s = float(rng.uniform(6, 8)) if k < 2 else 0.5, float(rng.uniform(12, 13))
            aside = sweep(at_s, 4.0, WIDTH_M)
            if k == 0:
                aside = total(aside, sweep(at_s + 12.0, 4.0, -WIDTH_M))
            ahead = 40.0 + at_s * gain
            drives += [
                Drive(f"tv{k}", 250.0 * k, 20.0 + gain, aside, 50.0),
                Drive(f"uv{k}", 250.0 * k + ahead, 20.0, 0.0, 50.0, kind="truck"),
            ]
        return replace(record(ROAD, *drives), scenario=scenario.name, seed=seed)


def study(pull_outs: int = 16) -> DatasetStudy:
    return small_study(
        seeds={"first": 1, "last": 2}, selection={"pull_outs": pull_outs}, pairs={"tv_kinds": ["passenger"]}
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("passing")
    return generate(study(), folder / "data", INLINE, source=PassingSource(folder))


def bytes_of(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "log.jsonl"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_dropped_pull_outs_are_stored_and_sensed_but_are_no_samples(dataset: Dataset) -> None:
    dataset.verify()
    frame = dataset.frame()
    changes = frame[frame["pull_out"] != ""].sort_values(["seed", "pull_out"])
    assert list(changes["pull_out"]) == ["not_passed", "overtaken"] * 2
    assert list(changes["intention"]) == ["left_lane_change", "overtake"] * 2
    assert dataset.meta.left_out()["passed_did_not_return"] == 2
    dropped = dropped_pull_outs(dataset)
    assert summary(dataset)["dropped_pull_outs"] == dropped.frame(["pull_out"])["pull_out"].value_counts().to_dict()
    table = dropped.frame()
    assert list(table["sample_id"]) == ["road-1-p0", "road-2-p0"]
    assert set(table["pull_out"]) == {"passed_did_not_return"}
    assert not set(table["sample_id"]) & set(frame["sample_id"])
    assert (table["t_pass"] - table["t_onset"]).between(4.5, 7.5).all()
    assert (table["t_pair_end"] > table["t_pass"] + 20).all()
    arrays = dropped.arrays("tv", "tv_truth")
    error = np.hypot(*np.moveaxis(arrays["tv"] - arrays["tv_truth"], 1, 0)[:2])
    assert 0 < np.median(error) < 0.2
    # The dataset itself neither counts nor reads them.
    assert len(dataset) == len(frame) == dataset.meta.samples == len(dataset.arrays("tv")["tv"])


def test_the_samples_are_the_same_without_them(dataset: Dataset, tmp_path: Path) -> None:
    without = generate(study(pull_outs=0), tmp_path / "data", INLINE, source=PassingSource(tmp_path))
    assert not (without.path / DROPPED_PULL_OUTS).exists()
    assert len(dropped_pull_outs(without)) == 0
    assert without.frame(SCALARS).equals(dataset.frame(SCALARS))
    for name, values in dataset.arrays(*ARRAYS).items():
        np.testing.assert_array_equal(without.arrays(name)[name], values)
    assert without.meta.left_out() == dataset.meta.left_out()


def test_what_is_missing_is_generated_again_to_the_same_bytes(dataset: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "data"
    shutil.copytree(dataset.path, folder)
    again = Dataset.open(folder)
    stray = folder / DROPPED_PULL_OUTS / "road-9.parquet"
    stray.write_bytes(b"PAR1")
    (folder / DROPPED_PULL_OUTS / "road-1.parquet").unlink()
    for read in (lambda: dropped_pull_outs(again), again.verify):
        with pytest.raises(InputError, match=r"dropped_pull_outs/road-1\.parquet.*missing or damaged"):
            read()
    (folder / "shards/road-1.parquet").unlink()
    generate(study(), folder, INLINE, source=PassingSource(tmp_path))
    assert bytes_of(folder) == bytes_of(dataset.path)


def test_dropped_pull_outs_are_sensed_anew_with_the_samples(dataset: Dataset, tmp_path: Path) -> None:
    same = resense(dataset, ResenseSettings(sensing=own_sensing(dataset)), tmp_path / "same", INLINE)
    truth = resense(dataset, ResenseSettings(sensor="truth", records=9), tmp_path / "truth", INLINE)
    before = dropped_pull_outs(dataset)
    for sensed, column in ((same, "tv"), (truth, "tv_truth")):
        sensed.verify()
        after = dropped_pull_outs(sensed)
        assert list(after.frame()["t_pass"]) == list(before.frame()["t_pass"])
        np.testing.assert_array_equal(after.arrays("tv")["tv"], before.arrays(column)[column])


def test_the_draw_among_dropped_pull_outs_is_even() -> None:
    offered = [
        Candidate(f"tv{k}", "u", Intention.LEFT_LANE_CHANGE, "natural", k, k + 2.6, k + 4.0, k + 5.0, "ahead")  # type: ignore[arg-type]
        for k in range(10)
    ]

    def chosen_of(settings: SelectionSettings, seed: int) -> list[Candidate]:
        drawn = draw_of_pull_outs(offered, settings, ("road", seed))
        return [candidate for candidate, _ in select([drawn], lambda batch: [True] * len(batch)).made]

    count = np.zeros(10)
    for seed in range(600):
        chosen = chosen_of(SelectionSettings(pull_outs=3), seed)
        assert [candidate.t_onset for candidate in chosen] == sorted({candidate.t_onset for candidate in chosen})
        assert len(chosen) == 3
        count[[offered.index(candidate) for candidate in chosen]] += 1
    assert (abs(count - 180) < 5 * np.sqrt(180 * 0.7)).all()
    assert chosen_of(SelectionSettings(), 1) == offered
