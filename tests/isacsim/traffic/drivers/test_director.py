"""The director: what it commands to whom, with which drawn parameters, and what it leaves alone."""

from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.director import Director
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import DriverSettings
from isac_cosim.isacsim.traffic.drivers.handling.driver_view import DriverView, ending_lanes
from isac_cosim.isacsim.traffic.drivers.handling.vehicle_control import DEFAULT_LANE_CHANGE_MODE, DEFAULT_SPEED_MODE
from isac_cosim.isacsim.traffic.drivers.maneuvers.hard_brake import BrakeCommandSettings
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Command, Recording
from isac_cosim.isacsim.traffic.sources.sumo import MISSED_EXIT_S, TrafficSettings, record, session
from tests.support.roads import straight_road, vehicle

RATES = [name for name in ManeuverSettings.model_fields if name.endswith("_hour")]
NONE = ManeuverSettings(**dict.fromkeys(RATES, 0.0))
STEP = 0.01


def new_director(scenario: Scenario, settings: ManeuverSettings) -> Director:
    return Director(settings, scenario.sites, scenario.origin, stream("test", 1), STEP)


def only(**rates: float) -> ManeuverSettings:
    return NONE.model_copy(update=rates)


def test_without_rates_nobody_is_commanded() -> None:
    scenario = load("ramp_weave")
    recording = record(scenario, 1, TrafficSettings(run_in_s=20.0, duration_s=5.0), NONE)
    assert recording.tracks
    assert recording.commands == ()
    assert NONE.quiet
    assert not any(only(**{name: 1.0}).quiet for name in RATES)


@pytest.mark.parametrize(("name", "ends"), [("motorway", ["merge_0"]), ("ramp_weave", ["merge_0"]), ("urban", [])])
def test_lanes_that_end_are_found(name: str, ends: list[str]) -> None:
    with session(load(name), 1, TrafficSettings()) as sumo:
        assert ending_lanes(sumo) == ends


def test_neither_pavements_nor_the_networks_own_ends_are_lanes_that_end() -> None:
    """a_0 ends beside a_1; b_1 is no lane for cars; edge c ends altogether; beside d_0 only buses go on."""
    linked = ("a_1", "b_0", "d_1")
    classes = {"b_1": ("pedestrian",), "d_1": ("bus", "tram")}
    lane = SimpleNamespace(
        getIDList=lambda: ["a_0", "a_1", "b_0", "b_1", "c_0", "c_1", "d_0", "d_1", ":n_0"],
        getLinks=lambda name: [("somewhere", True)] if name in linked else [],
        getEdgeID=lambda name: name[0],
        getAllowed=lambda name: classes.get(name, ()),
    )
    assert ending_lanes(SimpleNamespace(lane=lane)) == ["a_0"]


def test_a_lanes_end_is_closed_now_and_then_by_one_vehicle_at_a_time() -> None:
    scenario = load("ramp_weave")
    director = new_director(scenario, only(closed_ramp_end_per_lane_hour=600.0))
    with session(scenario, 1, TrafficSettings()) as sumo:
        for step in range(11_000):
            director.step(sumo, step * STEP)
            sumo.simulationStep()
            assert not sumo.simulation.getCollisions()
        director.finish(110.0)
        present = set(sumo.vehicle.getIDList())
        still = {command.vehicle for command in director.commands if command.end == 110.0}
        for vehicle_id in ({command.vehicle for command in director.commands} & present) - still:
            assert sumo.vehicle.getLaneChangeMode(vehicle_id) == DEFAULT_LANE_CHANGE_MODE
            assert sumo.vehicle.getSpeedMode(vehicle_id) == DEFAULT_SPEED_MODE
    assert {command.maneuver for command in director.commands} == {"closed_ramp_end"}
    times = sorted((command.start, command.end) for command in director.commands)
    assert len(times) >= 2
    assert all(end <= start for (_, end), (start, _) in pairwise(times))


def test_beside_a_closed_lane_nobody_is_commanded() -> None:
    scenario = load("ramp_weave")
    settings = only(closed_ramp_end_per_lane_hour=3600.0, hard_brake_per_vehicle_hour=3600.0, rest_s=1.0)
    director = new_director(scenario, settings)
    where: dict[tuple[str, float], str] = {}
    with session(scenario, 1, TrafficSettings()) as sumo:
        for step in range(5000):
            director.step(sumo, step * STEP)
            for vehicle_id in sumo.vehicle.getIDList() if step % 10 == 0 else ():
                where[vehicle_id, round(step * STEP, 6)] = sumo.vehicle.getRoadID(vehicle_id)
            sumo.simulationStep()
        director.finish(50.0)
    closures = [command for command in director.commands if command.maneuver == "closed_ramp_end"]
    brakes = [command for command in director.commands if command.maneuver == "hard_brake"]
    meanwhile = [brake for brake in brakes if any(c.start < brake.start < c.end for c in closures)]
    assert len(meanwhile) > 10
    assert all(where[brake.vehicle, round(brake.start, 6)] != "merge" for brake in meanwhile)


def same_until(a: Recording, b: Recording, time: float) -> bool:
    """Whether all states up to an instant are equal, to the last bit."""
    for name, track in a.tracks.items():
        rows = max(0, round(time / a.step_s) - track.first_step)
        if rows and not all(
            np.array_equal(getattr(track, c)[:rows], getattr(b.tracks[name], c)[:rows]) for c in COLUMNS
        ):
            return False
    return True


def test_closures_do_not_change_the_other_maneuvers() -> None:
    """Commands and states equal those without closures up to the first closure, and differ afterwards."""
    busy = only(hard_brake_per_vehicle_hour=100.0, debris_per_vehicle_hour=10.0, cut_in_per_vehicle_hour=6.0)
    # Sway depends on the whole drive, also on what comes later.
    brief = TrafficSettings(run_in_s=20.0, duration_s=25.0, sway=SwaySettings(sd_m=(0.0, 0.0)))
    without = record(load("ramp_weave"), 2, brief, busy)
    closing = busy.model_copy(update={"closed_ramp_end_per_lane_hour": 3600.0})
    with_closures = record(load("ramp_weave"), 2, brief, closing)

    def starts(commands: tuple[Command, ...], before: float) -> set[tuple[str, str, float]]:
        return {(c.vehicle, c.maneuver, c.start) for c in commands if c.start < before}

    first = min(c.start for c in with_closures.commands if c.maneuver == "closed_ramp_end")
    assert first > 21.0
    assert starts(without.commands, first) == starts(with_closures.commands, first) != set()
    assert same_until(without, with_closures, first)
    assert not same_until(without, with_closures, 45.0)


def test_where_no_lane_ends_closures_change_nothing(tmp_path: Path) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("a") + vehicle("b", depart=2.0, lane=0)))
    brief = TrafficSettings(run_in_s=2.0, duration_s=8.0)
    busy = ManeuverSettings(hard_brake_per_vehicle_hour=3600.0, closed_ramp_end_per_lane_hour=0.0)
    plain = record(scenario, 1, brief, busy)
    closing = record(scenario, 1, brief, busy.model_copy(update={"closed_ramp_end_per_lane_hour": 3600.0}))
    assert plain.commands == closing.commands != ()
    assert same_until(plain, closing, 10.0)


DRAWN = {
    "BrakeCommand": "peak_mps2",
    "Surge": "goal_mps",
    "SwerveCommand": "offset_m",
    "OvertakeCommand": "clearance_m",
    "SlowVehicleCommand": "slow_s",
    "StopInLaneCommand": "stand_s",
}
"""A value that is drawn for each command; its law is in `maneuvers.test_draws`."""


def test_every_command_has_parameters_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn anew each time; overtakes begin at headways of 0.8 to 2.5 s."""
    started: dict[str, list[float]] = defaultdict(list)
    headways: list[float] = []
    begin = Director._start

    def remembered(self: Director, sumo: Any, maneuver: Any, time: float) -> None:
        kind = type(maneuver).__name__
        started[kind].append(getattr(maneuver, DRAWN[kind]) if kind in DRAWN else 0.0)
        if kind == "OvertakeCommand":
            _, gap_m = sumo.vehicle.getLeader(maneuver.vehicle, 150.0)
            headways.append(gap_m / max(sumo.vehicle.getSpeed(maneuver.vehicle), 1.0))
        begin(self, sumo, maneuver, time)

    monkeypatch.setattr(Director, "_start", remembered)
    scenario = load("motorway")
    often = {
        **dict.fromkeys(RATES, 150.0),
        "debris_per_vehicle_hour": 20.0,
        "surge_per_vehicle_hour": 250.0,
        "swerve_per_vehicle_hour": 1500.0,
        "overtake_per_vehicle_hour": 3000.0,
    }
    director = new_director(scenario, only(**often, rest_s=1.0))
    with session(scenario, 1, TrafficSettings()) as sumo:
        for step in range(7000):
            director.step(sumo, step * STEP)
            sumo.simulationStep()
        director.finish(70.0)
    for kind in DRAWN:
        assert len(started[kind]) >= 4, kind
        assert len(set(started[kind])) == len(started[kind]), kind
    assert {"Evasion", "LaneChangeCommand", "CutInCommand"} <= started.keys()
    assert 0.8 < min(headways) < max(headways) < 2.5


def test_a_narrowed_range_reaches_the_motion_and_nothing_else_changes() -> None:
    """Brakes meant with 6.5 m/s2 instead of 3.6 to 8: the same vehicles are commanded first, each about that hard."""
    traffic = TrafficSettings(run_in_s=40.0, duration_s=20.0)
    brakes = only(hard_brake_per_vehicle_hour=200.0)
    exact = DriverSettings(noise_share=(0.0, 0.0), pedal_lag_s=(0.1, 0.1))
    narrow = BrakeCommandSettings(peak_mps2=(6.5, 6.5), rise_s=(0.0, 0.0), drop_mps=(13.0, 13.0))
    stronger = brakes.model_copy(update={"hard_brake": narrow, "driver": exact})
    recording = record(load("motorway"), 3, traffic, stronger)
    peaks = []
    for command in recording.commands:
        track = recording.tracks.get(command.vehicle)
        if track and command.maneuver == "hard_brake" and command.start > 41.0 and command.end < 59.0:
            rows = np.arange(command.start, command.end, STEP) / STEP - track.first_step
            if rows[0] >= 0 and rows[-1] < len(track) and track.speed[round(rows[0])] > 20.0:
                peaks.append(condition(track.speed, STEP, 0.15, 1, rows).min())
    assert len(peaks) >= 5
    np.testing.assert_allclose(peaks, -6.5, rtol=0.05)
    first = record(load("motorway"), 3, traffic, brakes).commands[0]
    assert (first.vehicle, first.start) in {(command.vehicle, command.start) for command in recording.commands}


def test_reactions_are_noted_with_their_cause() -> None:
    """Debris comes into view; drivers behind those who brake look away; both kinds are noted, with a time left."""
    busy = only(
        debris_per_vehicle_hour=200.0, surge_per_vehicle_hour=1000.0, hard_brake_per_vehicle_hour=200.0, rest_s=4.0
    )
    recording = record(load("motorway"), 4, TrafficSettings(run_in_s=40.0, duration_s=60.0), busy)
    causes = Counter(command.cause for command in recording.commands)
    assert causes["debris"] >= 10
    assert causes["gap_ahead"] > 5
    assert causes["braking_leader"] + causes["slow_leader"] + causes["stopped_leader"] >= 1
    for command in recording.commands:
        if command.cause == "debris":
            assert command.maneuver == "evasion"
            assert command.ttc_s is not None
            assert 0.0 < command.ttc_s < 4.5
        if command.cause in ("", "gap_ahead"):
            assert command.ttc_s is None


def test_nobody_is_sent_past_its_exit() -> None:
    """On the last 1.5 km before the off-ramp, which the rightmost lane leads to, at any speed that matters."""
    scenario = load("motorway")
    stay_s = NONE.stay_s
    time_left_s: dict[bool, list[float]] = {True: [], False: []}
    with session(scenario, 2, TrafficSettings()) as sumo:
        for step in range(15_000):
            sumo.simulationStep()
            if step % 100:
                continue
            for name in sumo.vehicle.getIDList():
                exits = sumo.vehicle.getRoute(name)[-1] == "offramp"
                if exits and sumo.vehicle.getLaneIndex(name) == 0 and sumo.vehicle.getSpeed(name) > 20.0:
                    allowed = DriverView(sumo, name, 150.0).has_lane(1, stay_s)
                    time_left_s[allowed].append(_ahead(sumo, name) / sumo.vehicle.getSpeed(name))
    assert min(time_left_s[True], default=0.0) > stay_s - 1.0
    assert time_left_s[False]
    assert max(time_left_s[False]) < stay_s + 12.0


def _ahead(sumo: Any, name: str) -> float:
    """Distance to the off-ramp along the route, m."""
    return float(sumo.vehicle.getDrivingDistance(name, "offramp", 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["motorway", "ramp_weave", "urban"])
def test_an_hour_of_stimulated_traffic_keeps_flowing(name: str) -> None:
    scenario = load(name)
    speeds: list[float] = []
    with session(scenario, 2, TrafficSettings()) as sumo:
        director = new_director(scenario, ManeuverSettings())
        for step in range(360_000):
            director.step(sumo, step * STEP)
            sumo.simulationStep()
            if step % 6000 == 0 and step:
                speeds.append(float(np.mean([sumo.vehicle.getSpeed(v) for v in sumo.vehicle.getIDList()])))
        director.finish(3600.0)
    print(
        name, "mean speed of every ten minutes, m/s:", np.reshape([*speeds, speeds[-1]], (6, 10)).mean(axis=1).round(1)
    )
    early = np.mean(speeds[1:10])
    assert np.mean(speeds[-10:]) > 0.7 * early


def test_a_vehicle_that_is_moved_on_under_command_is_given_back_to_its_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """SUMO teleports it; it would stand for good where it reappears."""
    monkeypatch.setattr("isac_cosim.isacsim.traffic.sources.sumo.MISSED_EXIT_S", 20.0)
    scenario = load("ramp_weave")
    director = new_director(scenario, only(closed_ramp_end_per_lane_hour=600.0))
    moved: set[str] = set()
    with session(scenario, 1, TrafficSettings()) as sumo:
        for step in range(6000):
            director.step(sumo, step * STEP)
            sumo.simulationStep()
            moved |= set(sumo.simulation.getStartingTeleportIDList()) & director.commanded
        free = moved & set(sumo.vehicle.getIDList()) - director.commanded
        assert free
        for name in free:
            assert sumo.vehicle.getSpeedMode(name) == DEFAULT_SPEED_MODE
            assert sumo.vehicle.getLaneChangeMode(name) == DEFAULT_LANE_CHANGE_MODE
            assert sumo.vehicle.getSpeed(name) > 1.0


def test_nobody_is_moved_on_while_it_stands_before_a_closed_ramp() -> None:
    assert ManeuverSettings().closed_ramp_end.stand_s[1] < MISSED_EXIT_S
