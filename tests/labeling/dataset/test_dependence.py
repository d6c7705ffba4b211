"""How far seeds depend on each other: fixed demands, drawn ones, the bundled scenarios, and near copies by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cosim
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.dependence import COLUMNS, Driven
from isac_cosim.labeling.dataset.summary import faults, summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support import made_up_dataset
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine

Make = Callable[[str, str], Dataset]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Generates two seeds of a road whose demand names every vehicle, or of a bundled scenario."""
    folder = tmp_path_factory.mktemp("seeds")
    sites = "".join(
        f'<poi id="s{k}" x="{60 + 150 * (k // 2)}" y="{80 if k % 2 else -80}" type="isac_site">'
        f'<param key="height" value="15"/><param key="azimuth" value="{180 if k % 2 else 0}"/></poi>'
        for k in range(24)
    )
    cars = "".join(vehicle(f"v{k}", 2.5 * k, lane=1, speed=20.0) for k in range(12))
    road = straight_road(folder / "road", cars, sites)

    def made(where: str, demand: str) -> Dataset:
        content: dict[str, Any] = {
            "scenarios": [str(road) if where == "fixed" else where],
            "seeds": {"first": 1, "last": 2},
            "traffic": {"run_in_s": 30.0, "duration_s": 40.0, "demand": demand},
        }
        # Without commands, two seeds of the fixed demand differ by the drivers' chance alone.
        if where == "fixed":
            content["traffic"] |= {"speed_wander": {"sd_share": [0.0, 0.0]}}
        content["maneuvers"] = LEFT_ALONE if where == "fixed" else {"rest_s": 1.0}
        return generate(checked(DatasetStudy, content, "test"), folder / f"{where}-{demand}", InlineEngine())

    return made


def test_a_fixed_demand_puts_its_vehicles_into_every_seed(make: Make, capsys: pytest.CaptureFixture[str]) -> None:
    dataset = make("fixed", "as_given")
    frame = dataset.frame(["tv_id", "tv_departed"])
    assert len(frame) > 5
    # The departures that the demand names, not those at which there was room.
    assert (frame["tv_departed"] == frame["tv_id"].str.removeprefix("v").astype(float) * 2.5).all()
    assert cosim.main(["inspect", str(dataset.path), "--json"]) == 0
    shown = capsys.readouterr()
    dependence = json.loads(shown.out)["dependence"]
    assert dependence["shared_tv"] >= 0.5 * dependence["samples"]
    assert dependence["near_copies"] > 0
    warnings = [line for line in shown.err.splitlines() if "in another seed" in line]
    assert len(warnings) == 1
    assert "--demand drawn" in warnings[0]


def test_departures_drawn_anew_make_the_seeds_independent(make: Make) -> None:
    dataset = make("fixed", "drawn")
    frame = dataset.frame(["tv_id", "tv_departed"])
    later_s = frame["tv_departed"] - frame["tv_id"].str.removeprefix("v").astype(float) * 2.5
    assert later_s.between(0.0, 60.0).all()
    assert later_s.max() > 1.0
    assert Driven.of(dataset).between_seeds().shared_tv == 0


@pytest.mark.parametrize("scenario", ["motorway", "urban"])
def test_seeds_of_bundled_scenarios_are_independent(make: Make, scenario: str) -> None:
    dataset = make(scenario, "as_given")
    found = Driven.of(dataset).between_seeds()
    assert found.samples > 10
    assert found.shared_tv is not None
    assert max(found.shared_tv, found.near_copies) <= 0.01 * found.samples
    assert not any("another seed" in line for line in faults(summary(dataset)))


def driven(rows: list[tuple[int, str, float, float, float]]) -> Driven:
    """TVs by seed, id, departure, onset and lateral place; they drive 20 m/s along x."""
    table = pd.DataFrame(
        [("road", seed, 0, tv, departed, onset - 2.6, onset) for seed, tv, departed, onset, _ in rows], columns=COLUMNS
    )
    along = 20.0 * np.arange(5.0)
    paths = np.array([np.concatenate([along, np.full(5, y)]) for *_, y in rows])
    return Driven(table, paths)


def test_near_copies_are_of_the_same_place_and_time() -> None:
    twins = driven([
        (1, "a", 5.0, 100.0, 0.0),
        (2, "b", 6.0, 101.9, 1.9),  # a copy of the first
        (2, "c", 7.0, 102.1, 0.0),  # too late
        (3, "d", 8.0, 100.0, -2.1),  # too far aside
        (1, "e", 9.0, 100.0, 0.1),  # a copy of the second alone: of the first's own seed
    ])  # fmt: skip
    found = twins.between_seeds()
    assert (found.samples, found.near_copies, found.shared_tv) == (5, 3, 0)


def test_the_same_id_at_another_time_is_another_vehicle() -> None:
    """Flows number their vehicles: the tenth of two seeds is the same one only if it departs at the same time."""
    twins = driven([(1, "f.9", 5.0, 100.0, 0.0), (2, "f.9", 5.4, 200.0, 0.0), (3, "f.9", 5.0, 300.0, 0.0)])
    assert twins.between_seeds().shared_tv == 2
    unknown = driven([(1, "f.9", math.nan, 100.0, 0.0), (2, "f.9", math.nan, 200.0, 0.0)])
    assert unknown.between_seeds().shared_tv is None


ROWS = st.lists(
    st.tuples(
        st.integers(1, 3), st.sampled_from("ab"), st.sampled_from([1.0, 2.0, math.nan]), st.floats(100, 104),
        st.floats(0, 5), st.booleans(), st.booleans(),
    ),
    max_size=12,
)  # fmt: skip


@given(ROWS)
def test_twins_are_those_that_a_comparison_of_every_pair_finds(rows: list[tuple[Any, ...]]) -> None:
    if not rows:
        return
    twins = driven([row[:5] for row in rows])
    asked, others = (np.array([row[k] for row in rows]) for k in (5, 6))

    def elsewhere(a: tuple[Any, ...], same: Callable[[tuple[Any, ...]], bool]) -> bool:
        return any(b[6] and b[0] != a[0] and same(b) for b in rows)

    copies = [
        elsewhere(a, lambda b, a=a: abs(a[3] - b[3]) <= 2 and abs(a[4] - b[4]) <= 2)  # type: ignore[misc]
        for a in rows
        if a[5]
    ]
    shared = [elsewhere(a, lambda b, a=a: a[1:3] == b[1:3]) for a in rows if a[5] and not math.isnan(a[2])]  # type: ignore[misc]
    found = twins.between(asked, others)
    assert found.near_copies == sum(copies)
    assert (found.shared_tv or 0) == sum(shared)


def test_a_seed_without_samples_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the last block of a recording that ends before any maneuver does."""
    records = made_up_dataset.make_records(3, 2)
    fewer = SimpleNamespace(table=records.table[records.table["seed"] != 1], tv=records.tv, uv=records.uv)
    monkeypatch.setattr(made_up_dataset, "make_records", lambda *_: fewer)
    dataset = made_up_dataset.write_dataset(tmp_path, seeds=3)
    assert 0 < dataset.meta.samples < len(records.table)
    assert len(Driven.of(dataset).paths) == dataset.meta.samples
