"""The cases of Table I differ from the generated dataset in what the paper says, and in nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.studies.reproduction.experiments.sensing_cases import (
    TRAINED,
    SensingCase,
    description,
    of_groups,
    resense_settings,
    weather_cases,
)
from tests.support.made_up_dataset import write_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_dataset(tmp_path_factory.mktemp("cases") / "data")


def changes(dataset: Dataset, case: SensingCase, snr: str | None = None) -> dict[str, Any]:
    """What differs from the dataset's own sensing, by key."""
    settings = resense_settings(dataset, case, snr).sensing
    stored = SensingSettings.model_validate(dataset.meta.study.get("sensing", {}))
    different = {}
    for name, value in settings:
        if value == getattr(stored, name):
            continue
        before = getattr(stored, name)
        if isinstance(value, str):
            different[name] = value
        else:
            different |= {f"{name}.{key}": item for key, item in value if item != getattr(before, key)}
    return different


def case(name: str) -> SensingCase:
    return next(case for case in [*TRAINED, *weather_cases("isac")] if case.name == name)


def test_the_papers_chain(dataset: Dataset) -> None:
    assert changes(dataset, case("isac-grid")) == {"estimator": "grid", "fusion.method": "eq5"}
    parabola = {"estimator": "padded_parabola", "fusion.method": "eq5"}
    assert changes(dataset, case("isac-padded-parabola")) == parabola
    assert changes(dataset, case("isac-padded-grid")) == {"estimator": "padded_grid", "fusion.method": "eq5"}
    assert resense_settings(dataset, case("isac-grid")).sensing.fusion.eq5_weights == "paper"


def test_adverse_weather_is_rain_or_a_loss(dataset: Dataset) -> None:
    assert changes(dataset, case("isac-rain")) == {"channel.rain_mm_per_h": 150.0}
    low, high = SensingSettings.model_validate(dataset.meta.study.get("sensing", {})).channel.snr_range_db
    assert changes(dataset, case("isac-loss")) == {"channel.snr_range_db": (low - 20, high - 20)}
    estimators = {case.name: case.sensing.get("estimator") for case in weather_cases("isac-grid")}
    assert estimators == {"isac-grid-rain": "grid", "isac-grid-loss": "grid"}


def test_a_test_snr_replaces_the_channel(dataset: Dataset) -> None:
    channel = resense_settings(dataset, case("isac"), "-30").sensing.channel
    assert (channel.kind, channel.snr_db) == ("fixed", -30.0)


def test_radar_and_truth(dataset: Dataset) -> None:
    conditions = {case.name: resense_settings(dataset, case).radar.condition for case in TRAINED if case.radar}
    assert conditions == {
        "radar-clear": "clear", "radar-nlos": "nlos", "radar-weather": "weather",
        "framework-clear": "clear", "framework-nlos": "nlos", "framework-weather": "weather",
    }  # fmt: skip
    framework = resense_settings(dataset, case("framework-weather")).radar
    assert (framework.cycle_s, framework.azimuth_sd_deg, framework.weather_factor) == (0.0025, 0.2, 10.0)
    assert resense_settings(dataset, case("truth")).sensor == "truth"
    assert {case.paper_case for case in TRAINED} == {1, 2, 3, 4, 5}


def test_a_part_of_a_dataset_is_what_its_seeds_hold(dataset: Dataset) -> None:
    table = dataset.frame(("scenario", "seed"))
    groups = (table["scenario"] + "-" + table["seed"].astype(str)).to_numpy()
    wanted = sorted(set(groups))[:1]
    part = of_groups(dataset, wanted)
    assert len(part) == (groups == wanted[0]).sum() > 0
    assert set(part.frame(("seed",))["seed"]) == {int(wanted[0].rpartition("-")[2])}


def test_the_position_error_is_the_median_of_medians(dataset: Dataset) -> None:
    states = dataset.arrays("tv", "tv_truth")
    apart = np.linalg.norm(states["tv"][:, :2] - states["tv_truth"][:, :2], axis=1)
    expected = np.median([np.median(record) for record in apart])
    assert description(dataset).median_position_error_m == pytest.approx(expected, abs=1e-5)
