"""Recordings from samples are those from every step."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording
from isac_cosim.isacsim.traffic.recordings.sampled_log import SampledLog
from isac_cosim.isacsim.traffic.recordings.state_log import EveryStepLog
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record, record_stepwise, session
from tests.support.recording_match import conditioned_rms
from tests.support.roads import straight_road, vehicle

BUSY = ManeuverSettings(
    hard_brake_per_vehicle_hour=60.0, swerve_per_vehicle_hour=60.0, left_change_per_vehicle_hour=60.0, rest_s=1.0
)
SHORT = TrafficSettings(run_in_s=45.0, duration_s=12.0)


def both(where: str | Path, traffic: TrafficSettings, maneuvers: ManeuverSettings) -> tuple[Recording, Recording]:
    """The recording from samples and that from every step."""
    scenario = load(str(where))
    sampled, full = (
        record(scenario, 3, traffic.model_copy(update={"sample_s": sample_s}), maneuvers) for sample_s in (0.1, 0.01)
    )
    return sampled, full


@pytest.fixture(scope="module")
def recorded() -> tuple[Recording, Recording]:
    return both("motorway", SHORT, BUSY)


def test_both_are_of_the_same_traffic(recorded: tuple[Recording, Recording]) -> None:
    sampled, full = recorded
    assert (sampled.commands, sampled.incidents, sampled.parked) == (full.commands, full.incidents, full.parked)
    assert len(full.commands) > 5
    assert list(sampled.tracks) == list(full.tracks)
    for name, track in full.tracks.items():
        assert (sampled.tracks[name].first_step, len(sampled.tracks[name])) == (track.first_step, len(track))


def test_raw_states_differ_by_less_than_a_thousandth(recorded: tuple[Recording, Recording]) -> None:
    """Root mean square; what is sampled is the same, to the last bit."""
    sampled, full = recorded
    same = []
    for column in (name for name in COLUMNS if name not in ("lane", "lane_lat")):
        error = np.concatenate(
            [getattr(sampled.tracks[name], column) - getattr(track, column) for name, track in full.tracks.items()]
        )
        assert np.sqrt(np.mean(error**2)) < 1e-3, column
        same.append(np.mean(error == 0.0))
    assert 0.1 < min(same) < 1.0, "states are neither all rebuilt nor all taken"
    flipped = [np.sum(sampled.tracks[name].lane != track.lane) for name, track in full.tracks.items()]
    assert max(flipped) <= 10


def test_conditioned_states_differ_by_less_than_a_millimetre(recorded: tuple[Recording, Recording]) -> None:
    x, v, a = conditioned_rms(*recorded)
    assert 0.0 < x < 1e-3
    assert v < 5e-3
    assert a < 5e-2


def test_a_stay_beside_the_road_begins_and_ends_at_its_steps(tmp_path: Path) -> None:
    stop = '<busStop id="stop" lane="e0_1" startPos="180" endPos="220"/>'
    bus = vehicle("bus").replace("/>", '><stop busStop="stop" duration="6" parking="true"/></vehicle>')
    road = straight_road(tmp_path / "road", bus, additional=stop)
    sampled, full = both(road, TrafficSettings(run_in_s=0.0, duration_s=40.0), ManeuverSettings(**LEFT_ALONE))
    assert sampled.parked == full.parked != {}
    y, whole_y = sampled.tracks["bus"].y, full.tracks["bus"].y
    assert np.ptp(whole_y) > 1.0
    np.testing.assert_allclose(y, whole_y, atol=0.02)
    np.testing.assert_array_equal(sampled.tracks["bus"].lane, full.tracks["bus"].lane)


@pytest.mark.parametrize("run_in_s", [0.0, 20.0])
def test_a_vehicle_beside_the_road_is_where_it_was_in_its_lane(tmp_path: Path, run_in_s: float) -> None:
    """To the last bit, though libsumo says neither its lane nor its place across: it came from another lane."""
    stop = '<busStop id="stop" lane="e0_1" startPos="180" endPos="220"/>'
    bus = vehicle("bus", lane=0).replace("/>", '><stop busStop="stop" duration="20" parking="true"/></vehicle>')
    road = straight_road(tmp_path / "road", bus, additional=stop)
    traffic = TrafficSettings(run_in_s=run_in_s, duration_s=40.0, sway=SwaySettings(sd_m=(0.0, 0.0)))
    sampled, full = both(road, traffic, ManeuverSettings(**LEFT_ALONE))
    ((first, after),) = full.parked["bus"]
    track, whole = sampled.tracks["bus"], full.tracks["bus"]
    assert (first < whole.first_step) == (run_in_s > 0.0)
    stay = slice(max(0, first + 20 - whole.first_step), after - 20 - whole.first_step)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(track, column)[stay], getattr(whole, column)[stay])
    assert (whole.lane_lat[stay] != 0.0).all()
    assert len(whole.lane_lat[stay]) > 500


def test_other_devices_are_drawn_as_with_every_step() -> None:
    """SUMO draws who has which device from one stream of numbers."""
    scenario = load("motorway")
    scenario = replace(scenario, kept={**scenario.kept, "device.rerouting.probability": "0.5"})
    drawn = []
    for log in (SampledLog(scenario, 0.01, 0, 0.1), EveryStepLog(scenario, 0.01, 0)):
        with session(scenario, 3, TrafficSettings(), log=log) as sumo:
            for _ in range(1500):
                sumo.simulationStep()
            vehicles = sumo.vehicle.getIDList()
            drawn.append({name: sumo.vehicle.getParameter(name, "has.rerouting.device") for name in vehicles})
    assert drawn[0] == drawn[1]
    assert set(drawn[0].values()) == {"true", "false"}


def test_a_driver_that_decides_at_every_step_is_followed(tmp_path: Path) -> None:
    """Behind a slower one, so that its acceleration changes at every step; and one that arrives in mid-lane."""
    hasty = '<vType id="hasty" actionStepLength="0.01" accel="2.5" decel="4"/>'
    slow = vehicle("slow", speed=8.0).replace("/>", ' arrivalPos="300"/>')
    demand = hasty + slow + vehicle("hurried", depart=4.0).replace('type="car"', 'type="hasty"')
    road = straight_road(tmp_path / "road", demand)
    sampled, full = both(road, TrafficSettings(run_in_s=0.0, duration_s=35.0), ManeuverSettings(**LEFT_ALONE))
    assert list(sampled.tracks) == list(full.tracks)
    for name, track in full.tracks.items():
        assert len(sampled.tracks[name]) == len(track)
        np.testing.assert_allclose(sampled.tracks[name].x, track.x, atol=5e-3)


def test_a_vehicle_that_is_on_the_road_for_less_than_a_sample_has_its_track(tmp_path: Path) -> None:
    brief = vehicle("brief", depart=1.03, lane=0, position=1450.0).replace("/>", ' arrivalPos="1451"/>')
    brief = '<route id="first" edges="e0"/>' + brief.replace('route="all"', 'route="first"')
    road = straight_road(tmp_path / "road", vehicle("a") + brief)
    sampled, full = both(road, TrafficSettings(run_in_s=0.0, duration_s=3.0), ManeuverSettings(**LEFT_ALONE))
    assert list(sampled.tracks) == list(full.tracks)
    assert [len(track) for track in sampled.tracks.values()] == [len(track) for track in full.tracks.values()]


def test_vehicles_that_the_caller_steers_are_sampled_more_often(tmp_path: Path) -> None:
    """A speed that changes between two decisions of the driver is followed where the caller names the vehicle."""
    scenario = load(str(straight_road(tmp_path / "road", vehicle("steered"))))
    traffic = TrafficSettings(run_in_s=0.0, duration_s=12.0, sample_s=0.1)

    def speed(settings: TrafficSettings, named: bool) -> np.ndarray:
        moments = record_stepwise(scenario, 3, settings, ManeuverSettings(**LEFT_ALONE))
        while True:
            try:
                moment = next(moments)
            except StopIteration as stop:
                recording: Recording = stop.value
                return recording.tracks["steered"].speed
            if 4.0 <= moment.time_s < 8.0:
                moment.sumo.vehicle.setSpeed("steered", 15.0 + 0.3 * np.sin(2 * np.pi * moment.time_s / 0.35))
                moment.steered.update({"steered"} if named else ())

    full = speed(traffic.model_copy(update={"sample_s": traffic.step_s}), True)
    error, unnamed_error = (np.abs(speed(traffic, named) - full).max() for named in (True, False))
    assert error < 0.1
    assert unnamed_error > 3 * error
