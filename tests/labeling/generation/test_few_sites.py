"""A place with sites on a part of its roads: candidates in view take the place of those that no site sees."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from tests.support.drives import Drive, Road, Stretch, ramps, record
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

ROAD = Road((Stretch(20_000.0),))
PAIRS, APART_M, IN_VIEW = 24, 800.0, 8
SITES = tuple(Site(f"s{k}", 200.0 * (k // 2), 150.0 if k % 2 else -150.0, 20.0, 180.0 * (k % 2)) for k in range(60))
"""Along the first 6 of 20 km."""
CAP = 4


class LongRoad(ScriptedSource):
    """Pairs of vehicles all along a road; the second one of each brakes hard."""

    def load(self, where: str) -> Scenario:
        return replace(super().load(where), lanes=ROAD.lanes(), sites=SITES)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        drives = []
        for k in range(PAIRS):
            brake = ramps((0, 20.0), (12 + 0.1 * k, 20.0), (13.5 + 0.1 * k, 11.0), (60, 11.0))
            drives += [
                Drive(f"tv{k}", 100.0 + APART_M * k, brake, duration_s=25.0),
                Drive(f"uv{k}", 140.0 + APART_M * k, 20.0, duration_s=25.0, kind="truck"),
            ]
        return replace(record(ROAD, *drives), scenario=scenario.name, seed=seed)


def made(folder: Path, engine: InlineEngine | LocalEngine, cap: int = CAP) -> Dataset:
    study = small_study(
        seeds={"first": 1, "last": 3}, selection={"per_class": cap, "following": 0}, pairs={"tv_kinds": ["passenger"]}
    )
    folder.mkdir(parents=True, exist_ok=True)
    return generate(study, folder / "data", engine, source=LongRoad(folder))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return made(tmp_path_factory.mktemp("long"), InlineEngine())


def test_as_many_samples_as_stand_in_view_up_to_the_cap(dataset: Dataset) -> None:
    dataset.verify()
    frame = dataset.frame()
    assert Counter(frame["seed"]) == {1: CAP, 2: CAP, 3: CAP}
    assert set(frame["intention"]) == {"hard_brake"}
    assert {int(name.removeprefix("tv")) for name in frame["tv_id"]} <= set(range(IN_VIEW))
    for _, of_seed in frame.groupby("seed"):
        assert list(of_seed["t_onset"]) == sorted(of_seed["t_onset"])
        assert of_seed["tv_id"].is_unique


def test_every_candidate_is_a_sample_or_is_counted_once(dataset: Dataset) -> None:
    for shard in dataset.meta.shards:
        left_out = shard.episode.left_out
        assert shard.samples + left_out["too_few_sites"] + left_out.get("beyond_cap", 0) == PAIRS
        assert left_out["too_few_sites"] > 0


def test_where_the_view_holds_fewer_than_the_cap_nothing_is_beyond_it(tmp_path: Path) -> None:
    every = made(tmp_path, InlineEngine(), cap=16)
    for shard in every.meta.shards:
        assert shard.samples == IN_VIEW
        assert shard.episode.left_out == {"too_few_sites": PAIRS - shard.samples}


@pytest.mark.slow
def test_the_same_bytes_whatever_the_jobs(dataset: Dataset, tmp_path: Path) -> None:
    again = made(tmp_path, LocalEngine(2))
    assert again.digest == dataset.digest


def test_samples_that_are_replaced_do_not_change_the_others(dataset: Dataset, tmp_path: Path) -> None:
    """A sample is the same, state by state, whichever candidates were asked with it."""
    every = made(tmp_path, InlineEngine(), cap=16)
    keys = ["seed", "tv_id"]
    rows = every.frame(keys).reset_index().merge(dataset.frame(keys), on=keys)["index"].to_numpy()
    assert len(rows) == len(dataset)
    np.testing.assert_array_equal(every.arrays("tv")["tv"][np.sort(rows)], dataset.arrays("tv")["tv"])
