"""Vehicles that stop beside the road: nobody commands them, and nobody follows them."""

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import DEFAULT_LANE_CHANGE_MODE, DEFAULT_SPEED_MODE
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record, session
from isac_cosim.labeling.road.surroundings import Surroundings
from tests.isacsim.traffic.drivers.test_director import STEP, new_director, only
from tests.support.roads import straight_road, vehicle

RATES = [name for name in ManeuverSettings.model_fields if name.endswith("_per_vehicle_hour")]
STOP = '<busStop id="stop" lane="e0_1" startPos="180" endPos="220"/>'
TRAFFIC = TrafficSettings(run_in_s=0.0, duration_s=40.0)


def bus_road(folder: Path) -> Path:
    """Make a road on which a bus stops beside the middle lane, and a car drives up from behind."""
    bus = vehicle("bus").replace("/>", '><stop busStop="stop" duration="8" parking="true"/></vehicle>')
    return straight_road(folder / "road", bus + vehicle("car", depart=8.0, speed=20.0), additional=STOP)


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(load(bus_road(tmp_path_factory.mktemp("stop"))), 1, TRAFFIC, only())


def test_a_stay_beside_the_road_is_recorded(parked: Recording) -> None:
    """For the steps in which SUMO itself places the vehicle beside its lane."""
    track = parked.tracks["bus"]
    beside = np.abs(track.y - track.y[0]) > 1.0
    first, after = track.first_step + np.flatnonzero(beside)[[0, -1]] + (0, 1)
    assert after - first > 500
    assert parked.parked == {"bus": ((first, after),)}


@pytest.mark.parametrize("place", ['busStop="stop" parking="true"', 'parkingArea="beside"'])
@pytest.mark.parametrize(
    ("until", "action_step_s", "lasts_s"),
    [
        ('duration="8"', 0.1, 8.0),
        ('duration="8"', 0.01, 8.0),
        ('until="25"', 0.1, None),
        ('duration="2" until="25"', 0.1, None),
    ],
)
def test_a_stop_beside_the_road_lasts_as_long_as_it_is_meant_to(
    tmp_path: Path, place: str, until: str, action_step_s: float, lasts_s: float | None
) -> None:
    """For its duration, or until the time that it names."""
    bus = vehicle("bus").replace("/>", f"><stop {place} {until}/></vehicle>")
    area = '<parkingArea id="beside" lane="e0_1" startPos="180" endPos="220" roadsideCapacity="4"/>'
    road = straight_road(tmp_path / "road", bus, additional=STOP + area)
    recording = record(load(road), 1, TRAFFIC.model_copy(update={"action_step_s": action_step_s}), only())
    ((first, after),) = recording.parked["bus"]
    if lasts_s is None:
        assert after * recording.step_s == pytest.approx(25.0, abs=0.05)
    else:
        assert (after - first) * recording.step_s == pytest.approx(lasts_s, abs=0.05)


def test_a_stay_that_the_recording_cuts_off_ends_with_the_track(tmp_path: Path) -> None:
    brief = TrafficSettings(run_in_s=16.0, duration_s=2.0)
    recording = record(load(bus_road(tmp_path)), 1, brief, only())
    track = recording.tracks["bus"]
    ((first, after),) = recording.parked["bus"]
    assert first < track.first_step
    assert after == track.first_step + len(track)


def test_a_parked_vehicle_is_nobodys_leader_and_has_none(parked: Recording) -> None:
    """The car passes the bus in the same lane while the bus is parked, and is ahead of it afterwards."""
    surroundings, bus, car = Surroundings(parked), parked.tracks["bus"], parked.tracks["car"]
    ((first, after),) = parked.parked["bus"]
    for step in range(car.first_step + 10, first + 1500, 10):
        time, row = step * parked.step_s, step - car.first_step
        stands = first <= step < after
        behind = car.lane_pos[row] < bus.lane_pos[step - bus.first_step]
        leader = surroundings.leader("car", time, 500.0)
        assert (leader is not None) == (behind and not stands), time
        assert surroundings.has("bus", time, time) is not stands
        assert ("bus" in {track.vehicle for track in surroundings.present(time)}) is not stands
        assert np.isnan(surroundings.gaps("car", "bus", np.array([time]))[0]) == stands
        assert not (stands and surroundings.leader("bus", time, 500.0))
    assert not surroundings.has("bus", first * 0.01 - 2.0, after * 0.01 + 2.0)


@pytest.mark.parametrize("rate", RATES)
def test_no_parked_vehicle_is_commanded(tmp_path: Path, rate: str) -> None:
    """Every vehicle is commanded as soon as it may be, also while it comes to the stop."""
    scenario = load(bus_road(tmp_path))
    director = new_director(scenario, only(**{rate: 3600.0}, rest_s=0.0, within_m=1e5))
    stays: list[float] = []
    factors = set()
    with session(scenario, 1, TRAFFIC) as sumo:
        for step in range(4000):
            director.step(sumo, step * STEP)
            sumo.simulationStep()
            if "bus" in sumo.vehicle.getIDList() and sumo.vehicle.isStoppedParking("bus"):
                stays.append(step * STEP)
                if len(stays) > 2:
                    assert sumo.vehicle.getLaneChangeMode("bus") == DEFAULT_LANE_CHANGE_MODE
                    assert sumo.vehicle.getSpeedMode("bus") == DEFAULT_SPEED_MODE
                    factors.add(sumo.vehicle.getSpeedFactor("bus"))
        director.finish(40.0)
    bus = [command for command in director.commands if command.vehicle == "bus"]
    assert not stays or factors == {0.8}
    for command in bus:
        assert not any(command.start < time < command.end - 2 * STEP for time in stays)
