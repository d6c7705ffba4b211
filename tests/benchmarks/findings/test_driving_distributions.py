"""How often and how densely people drive here: counted on made-up tracks, and compared with published rates."""

import numpy as np
import pytest

from isac_cosim.benchmarks.findings.driving_distributions import moving, rates, speed_limits, time_gaps
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings

STEP, LASTS_S, LIMIT = 0.01, 30.0, 25.0
LANES = tuple(Lane(f"e_{k}", "e", k, 3.6, 2000.0, np.array([[0.0, 3.6 * k], [2000.0, 3.6 * k]]), ()) for k in range(2))


def car(name: str, start_m: float, speed: float, change_s: float | None = None, kind: str = "passenger") -> Track:
    """A car at constant speed. At a time, if one is given, it is halfway from the right lane to the left one."""
    times = np.arange(0.0, LASTS_S, STEP)
    across = np.zeros(len(times)) if change_s is None else 3.6 * np.clip((times - change_s) / 4.0 + 0.5, 0.0, 1.0)
    lane = (across > 1.8).astype(np.int64)
    along = start_m + speed * times
    return Track(name, kind, 5.0, 1.8, 0, along, across, np.full(len(times), speed), lane, along, across - 3.6 * lane)


def road(*tracks: Track, parked: dict[str, tuple[tuple[int, int], ...]] | None = None) -> Recording:
    return Recording("made_up", 1, STEP, LANES, {track.vehicle: track for track in tracks}, parked=parked or {})


def measured(recording: Recording) -> dict[str, float]:
    return rates(recording, label(recording, LabelSettings()), {lane.id: LIMIT for lane in LANES})


def test_rates_are_counts_over_the_way_and_the_time_of_all_vehicles() -> None:
    """30 s at 20, 24 and 30 m/s are 2.22 km and 1/40 h; one of the three changes lanes."""
    values = measured(road(car("a", 600.0, 20.0), car("b", 300.0, 24.0, change_s=15.0), car("c", 0.0, 30.0)))
    assert values["vehicle-km"] == pytest.approx(2.22)
    assert values["vehicle-hours"] == pytest.approx(1.0 / 40.0)
    assert values["lane changes, per km"] == values["left lane changes, per km"] == pytest.approx(1.0 / 2.22)
    assert values["lane changes, per hour"] == pytest.approx(40.0)
    assert values["right lane changes, per km"] == values["hard brakes, per hour"] == 0.0
    assert values["speed of cars, mean, km/h"] == pytest.approx(3.6 * 74.0 / 3.0)
    # The one behind closes in from 11.8 s to 2 s; the other two are free, except that the middle one comes near.
    assert values["free cars 14 % above the limit, %"] > 0.0


def test_a_headway_is_from_rear_to_front_over_the_followers_speed() -> None:
    gaps = list(
        time_gaps(road(car("ahead", 50.0, 20.0), car("behind", 25.0, 20.0), car("truck", 0.0, 20.0, None, "truck")))
    )
    np.testing.assert_allclose(gaps, 1.0)
    assert len(gaps) == 2 * 6
    values = measured(road(car("ahead", 40.0, 20.0), car("behind", 25.0, 20.0), car("last", 0.0, 20.0)))
    # Gaps of 0.5 and 1 s, to equally fast vehicles; the first one has none.
    assert values["time gaps below 1 s, % of followers within 3 s"] == pytest.approx(50.0)
    assert values["time gaps below 2 s, % of all"] == pytest.approx(200.0 / 3.0)
    assert values["time gap of close followers, mean, s"] == pytest.approx(0.75)
    assert values["time gap of close followers, sd, s"] == pytest.approx(0.25)


def test_who_stands_beside_the_road_neither_drives_nor_leads() -> None:
    recording = road(car("a", 100.0, 20.0), car("b", 0.0, 20.0), parked={"a": ((0, 3000),)})
    assert {vehicle.gap_s for vehicle in moving(recording)} == {np.inf}
    assert measured(recording)["vehicle-hours"] == pytest.approx(LASTS_S / 3600.0)


def test_speed_limits_are_those_of_the_network() -> None:
    limits = speed_limits(load("motorway"))
    assert (limits["west_0"], limits["onramp_0"]) == (36.11, 22.22)


@pytest.mark.slow
def test_natural_drivers_change_lanes_about_as_often_as_people_do() -> None:
    """Without ramps, as on highD's road (0.12 a km), and with two of them in 4 km (commuters: 0.225)."""
    traffic = TrafficSettings(duration_s=120.0, sample_s=0.1)
    for name, least, most in (("straight_road", 0.08, 0.15), ("motorway", 0.15, 0.30)):
        scenario, changes, km = load(name), 0.0, 0.0
        limits = speed_limits(scenario)
        for seed in (1, 2, 3):
            recording = record(scenario, seed, traffic, ManeuverSettings(**LEFT_ALONE))
            values = rates(recording, label(recording, LabelSettings()), limits)
            changes += values["lane changes, per km"] * values["vehicle-km"]
            km += values["vehicle-km"]
            assert values["collided"] == 0
        assert least < changes / km < most, name
