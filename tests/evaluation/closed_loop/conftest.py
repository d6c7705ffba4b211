"""A small road with a few vehicles, and the alarms of small trees."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.evaluation.closed_loop.episode import Alarming
from isac_cosim.evaluation.in_traffic.measurement.evaluation import study_of
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, LiveStudy
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run
from tests.support.roads import straight_road, vehicle

SITES = "".join(
    f'<poi id="s{k}" x="{100 + 80 * k}" y="{(-150, 150)[k // 2 % 2]}" type="isac_site"><param key="height" value="20"/>'
    f'<param key="azimuth" value="{(0, 180)[k // 2 % 2]}"/></poi>'
    for k in range(10)
)


@pytest.fixture(scope="session")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three vehicles behind each other in the middle lane, one in each of the others."""
    vehicles = [vehicle(f"v{k}", lane=1, position=250.0 - 45.0 * k) for k in range(3)]
    vehicles += [vehicle("left", lane=2, position=195.0), vehicle("right", lane=0, position=180.0)]
    return straight_road(tmp_path_factory.mktemp("road") / "road0", "".join(vehicles), sites=SITES)


@pytest.fixture(scope="session")
def scenario(road: Path) -> Scenario:
    return load(road)


@pytest.fixture(scope="session")
def infer(trees_run: Run) -> Infer:
    return Infer.load(trees_run.path)


@pytest.fixture(scope="session")
def study(infer: Infer, road: Path) -> LiveStudy:
    """Seven seconds of traffic in which vehicles now and then brake hard, at once."""
    content = study_of(infer.run.card, str(road), (1, 2), (11, 12), 7.0, natural=True).model_dump()
    content["dataset"]["maneuvers"] |= {"hard_brake_per_vehicle_hour": 300.0}
    content["dataset"]["maneuvers"]["hard_brake"] |= {"rise_s": (0.0, 0.0)}
    content["dataset"]["traffic"] |= {"run_in_s": 1.0}
    content["live"]["streams"] |= {"outcome_s": 0.0}
    content["live"]["background"] |= {"rounds": 5, "folds": 2}
    content["live"]["choice"] |= {"thresholds": 10, "confirmations": [[1, 1]], "least_probabilities": [0.0]}
    return LiveStudy.model_validate(content)


@pytest.fixture(scope="session")
def alarming() -> Alarming:
    """Alarms whatever the predictor answers."""
    settings = AlarmSettings(method="reject", threshold=-1e9)
    return Alarming(settings, None, dict.fromkeys(("hard_brake", "left_lane_change"), 600.0))
