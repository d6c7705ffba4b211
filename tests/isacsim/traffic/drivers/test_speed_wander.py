"""Wandering speeds: their spread, how fast they change, whom they leave alone, and that they brake nobody."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import EVERY_S, SpeedWander, SpeedWanderSettings
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

STEP = 0.01
NONE = ManeuverSettings(**LEFT_ALONE)


class Vehicles:
    """As much of libsumo as the wandering uses: vehicles and their speed factors."""

    def __init__(self, *names: str) -> None:
        self.factors = dict.fromkeys(names, 1.0)
        self.vehicle = SimpleNamespace(
            getIDList=lambda: tuple(self.factors),
            getSpeedFactor=self.factors.__getitem__,
            setSpeedFactor=self.factors.__setitem__,
            getAllowedSpeed=lambda name: 30.0 * self.factors[name],
            getSpeed=lambda name: 20.0,
        )


def wandering_factors(settings: SpeedWanderSettings, duration_s: float, *names: str) -> np.ndarray:
    """The speed factors after each update, (updates, vehicles)."""
    sumo, wander = Vehicles(*names), SpeedWander(settings, EVERY_S, duration_s, "road", 1)
    rows = []
    for _ in range(round(duration_s / EVERY_S)):
        wander.step(sumo, set())
        rows.append(list(sumo.factors.values()))
    return np.array(rows)


def test_each_driver_has_a_spread_of_its_own_within_the_range() -> None:
    shares = wandering_factors(SpeedWanderSettings(), 6000.0, *(f"v{k}" for k in range(20))) - 1.0
    spreads = shares[100:].std(axis=0)
    assert 0.015 * 0.8 < spreads.min() < 0.02 < spreads.max() < 0.03 * 1.1
    assert np.abs(shares.mean(axis=0)).max() < 0.01
    assert np.abs(np.diff(shares, axis=0)).max() <= SpeedWanderSettings().change_per_s * EVERY_S * (1.0 + 1e-9)


def test_a_vehicle_wanders_the_same_whoever_else_drives() -> None:
    alone = wandering_factors(SpeedWanderSettings(), 60.0, "v1")
    beside = wandering_factors(SpeedWanderSettings(), 60.0, "v0", "v1")
    np.testing.assert_array_equal(alone[:, 0], beside[:, 1])


def test_a_steered_vehicle_keeps_its_factor_and_catches_up_without_a_jump() -> None:
    sumo, wander = Vehicles("v"), SpeedWander(SpeedWanderSettings(), EVERY_S, 1000.0, "road", 1)
    for _ in range(500):
        wander.step(sumo, set())
    before = sumo.factors["v"]
    for _ in range(500):
        wander.step(sumo, {"v"})
    assert sumo.factors["v"] == before
    wander.step(sumo, set())
    assert 0.0 < abs(sumo.factors["v"] / before - 1.0) <= SpeedWanderSettings().change_per_s * EVERY_S * 1.1


def test_a_factor_that_somebody_else_changed_stays_changed() -> None:
    sumo, wander = Vehicles("v"), SpeedWander(SpeedWanderSettings(), EVERY_S, 1000.0, "road", 1)
    other = wandering_factors(SpeedWanderSettings(), 200.0, "v")[:, 0]
    for row in range(400):
        wander.step(sumo, set())
        if row == 200:
            sumo.factors["v"] *= 1.3
    assert sumo.factors["v"] == pytest.approx(1.3 * other[399])


def free_car(folder: Path, wander: SpeedWanderSettings) -> Track:
    """The only vehicle on a straight road, for 80 s."""
    road = straight_road(folder / "road", vehicle("car", speed=28.0))
    return record(load(road), 1, TrafficSettings(run_in_s=10.0, duration_s=80.0, speed_wander=wander), NONE).tracks[
        "car"
    ]


def test_a_free_driver_follows_the_wandering_gently(tmp_path: Path) -> None:
    steady = free_car(tmp_path, SpeedWanderSettings(sd_share=(0.0, 0.0)))
    assert np.ptp(steady.speed) < 0.06
    settings = SpeedWanderSettings(sd_share=(0.03, 0.03))
    track = free_car(tmp_path, settings)
    acceleration = condition(track.speed, STEP, 0.15, 1)
    assert 0.2 < track.speed.std() < 1.5
    assert np.abs(acceleration).max() < 1.5 * settings.change_per_s * 28.9
