"""Recordings: what SUMO reports, to the last bit, and the same for the same seed."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.temporary import LOCK_FILE
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.director import Director
from isac_cosim.isacsim.traffic.drivers.maneuvers.hard_brake import BrakeCommandSettings
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.motion import condition
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording
from isac_cosim.isacsim.traffic.recordings.state_log import EveryStepLog
from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning
from isac_cosim.isacsim.traffic.sources.sumo import LOG_FILE, TrafficSettings, record, session
from isac_cosim.labeling.dataset.shard import Episode
from isac_cosim.labeling.dataset.traffic_summary import traffic_faults, traffic_summary
from tests.support.roads import straight_road, vehicle

NONE = ManeuverSettings(**{name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")})
STEADY = {"sway": SwaySettings(sd_m=(0.0, 0.0)), "speed_wander": SpeedWanderSettings(sd_share=(0.0, 0.0))}
SHORT = TrafficSettings(sample_s=0.01, run_in_s=40.0, duration_s=15.0, **STEADY)
HARD = BrakeCommandSettings(peak_mps2=(6.0, 8.0), rise_s=(0.0, 0.0), drop_mps=(10.0, 14.0))
BRAKING = ManeuverSettings(hard_brake_per_vehicle_hour=200.0, hard_brake=HARD, rest_s=1.0)


@pytest.fixture(scope="module")
def motorway() -> Recording:
    return record(load("motorway"), 3, SHORT, BRAKING)


def same(a: Recording, b: Recording) -> bool:
    return (
        a.commands == b.commands
        and a.incidents == b.incidents
        and list(a.tracks) == list(b.tracks)
        and all(np.array_equal(getattr(a.tracks[v], c), getattr(b.tracks[v], c)) for v in a.tracks for c in COLUMNS)
    )


def test_the_same_seed_gives_the_same_recording_and_another_seed_another(motorway: Recording) -> None:
    assert same(motorway, record(load("motorway"), 3, SHORT, BRAKING))
    assert not same(motorway, record(load("motorway"), 4, SHORT, BRAKING))


def test_the_recording_is_what_libsumo_returns(motorway: Recording) -> None:
    """Equal, to the last bit, to the states that libsumo returns for every vehicle after every step."""
    scenario = load("motorway")
    lane_number = {lane.id: k for k, lane in enumerate(scenario.lanes)}
    rng = stream("maneuvers", scenario.name, 3)
    director = Director(BRAKING, scenario.sites, scenario.origin, rng, SHORT.step_s)
    returned: dict[str, list[tuple[float, ...]]] = {}
    first_step: dict[str, int] = {}
    facts: dict[str, tuple[str, float, float]] = {}
    with session(scenario, 3, SHORT) as sumo:
        get = sumo.vehicle
        for step in range(5500):
            director.step(sumo, step * 0.01)
            sumo.simulationStep()
            for name in get.getIDList() if step >= 4000 else ():
                first_step.setdefault(name, step + 1)
                facts[name] = (get.getVehicleClass(name), get.getLength(name), get.getWidth(name))
                along = (get.getSpeed(name), lane_number[get.getLaneID(name)], get.getLanePosition(name))
                returned.setdefault(name, []).append(
                    (*get.getPosition(name), *along, get.getLateralLanePosition(name)),
                )
        director.finish(55.0)
    left_out = {*motorway.incidents.collided, *motorway.incidents.teleported}
    assert [name for name in returned if name not in left_out] == list(motorway.tracks)
    for name, track in motorway.tracks.items():
        assert (track.kind, track.length_m, track.width_m) == facts[name]
        assert track.first_step == first_step[name]
        np.testing.assert_array_equal(np.stack([getattr(track, column) for column in COLUMNS], axis=1), returned[name])


def test_tracks_say_which_edges_lay_still_ahead(tmp_path: Path) -> None:
    """From the edge of the last state on; none for a vehicle that has arrived."""
    arrives = vehicle("arrives", 0.0, 0, 1400.0).replace('depart="0.0"', 'depart="0.0" departEdge="1"')
    others = vehicle("stays", 0.0, 1, 20.0) + vehicle("passes", 0.0, 2, 1480.0)
    road = load(straight_road(tmp_path / "road", arrives + others))
    tracks = record(road, 1, TrafficSettings(run_in_s=0.0, duration_s=10.0, **STEADY), NONE).tracks
    assert {name: track.onward for name, track in tracks.items()} == {
        "arrives": (), "stays": ("e0", "e1"), "passes": ("e1",),
    }  # fmt: skip
    assert [road.lanes[int(tracks[name].lane[-1])].edge for name in ("arrives", "stays", "passes")] == [
        "e1",
        "e0",
        "e1",
    ]


def test_states_are_every_10_ms_and_agree_with_each_other(motorway: Recording) -> None:
    """The distance between positions is the integral of the speed, on every edge, curve and ramp."""
    assert motorway.step_s == 0.01
    moved, driven = [], []
    for track in motorway.tracks.values():
        if len(track) > 1000:
            moved.append(np.hypot(np.diff(track.x), np.diff(track.y)).sum())
            driven.append(0.5 * (track.speed[1:] + track.speed[:-1]).sum() * 0.01)
    assert len(moved) > 15
    np.testing.assert_allclose(moved, driven, rtol=0.01)


def test_commands_show_in_the_motion(motorway: Recording) -> None:
    """That vehicles obeyed is seen in their states."""
    peaks = []
    for command in motorway.commands:
        track = motorway.tracks.get(command.vehicle)
        if command.maneuver == "hard_brake" and track and command.start > 41.0 and command.end < 54.0:
            rows = np.arange(command.start, command.end, 0.01) / 0.01 - track.first_step
            if rows[0] >= 0 and rows[-1] < len(track):
                peaks.append(condition(track.speed, 0.01, 0.15, 1, rows).min())
    assert len(peaks) >= 5
    assert max(peaks) < -4.0


def test_collided_vehicles_have_no_track(tmp_path: Path) -> None:
    """A stopped vehicle, and one that is made to drive into it, are both named and left out."""
    stopped = vehicle("wall", lane=1, position=300.0, speed=0.0).replace(
        "/>", '><stop lane="e0_1" startPos="290" endPos="310" duration="1000"/></vehicle>'
    )
    blind = (
        '<vType id="blind" carFollowModel="IDM" decel="0.3" emergencyDecel="0.3" speedFactor="0.8" speedDev="0" '
        'lcStrategic="-1" lcSpeedGain="0" lcKeepRight="0" lcCooperative="0" lcSublane="0"/>'
        '<vehicle id="blind" type="blind" route="all" depart="2" departLane="1" departPos="150" departSpeed="28" '
        'insertionChecks="none"/>'
    )
    scenario = load(straight_road(tmp_path / "road", stopped + vehicle("free", lane=0) + blind))
    recording = record(scenario, 1, TrafficSettings(run_in_s=0.0, duration_s=15.0), NONE)
    assert set(recording.incidents.collided) == {"blind", "wall"}
    assert set(recording.tracks) == {"free"}


def test_steps_of_5_ms_and_a_network_far_from_the_origin(tmp_path: Path) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("a", position=10.0, speed=25.0), shift=400_000.0))
    recording = record(scenario, 1, TrafficSettings(step_s=0.005, run_in_s=1.0, duration_s=2.0), NONE)
    track = recording.tracks["a"]
    assert track.first_step == 201
    np.testing.assert_allclose(track.x[0], 400_010.0 + 25.0 - scenario.origin[0], atol=2.0)
    np.testing.assert_allclose(np.diff(track.x), 0.5 * (track.speed[1:] + track.speed[:-1]) * 0.005, atol=1e-9)


def test_pedestrians_are_not_recorded_and_an_empty_road_gives_no_tracks(tmp_path: Path) -> None:
    walker = '<person id="p" depart="0"><walk edges="e0" departPos="10" arrivalPos="60"/></person>'
    scenario = load(straight_road(tmp_path / "road", walker + vehicle("a", depart=5.0)))
    assert set(record(scenario, 1, TrafficSettings(run_in_s=0.0, duration_s=6.0), NONE).tracks) == {"a"}
    assert record(scenario, 1, TrafficSettings(run_in_s=0.0, duration_s=4.0), NONE).tracks == {}


def test_a_vehicle_that_cannot_be_recorded_is_refused(tmp_path: Path) -> None:
    shy = vehicle("shy").replace("/>", '><param key="has.fcd.device" value="false"/></vehicle>')
    with pytest.raises(InputError, match=r"shy has the parameter has\.fcd\.device = false.*: remove the parameter"):
        record(load(straight_road(tmp_path / "road", shy)), 1, SHORT, NONE)


def test_the_states_have_no_file_name_while_sumo_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("a")))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    log = EveryStepLog(scenario, 0.01, 0)
    with session(scenario, 1, TrafficSettings(), log=log) as sumo:
        for _ in range(100):
            sumo.simulationStep()
            log.step(sumo)
        assert {file.name for file in tmp_path.glob("cosim-*/*")} == {LOG_FILE, LOCK_FILE}
    assert len(log.tracks()["a"]) == 100


def test_a_step_that_sumo_would_round_is_refused(tmp_path: Path) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("a")))
    with (
        pytest.raises(InputError, match=r"SUMO steps at 0\.003 s, not at step_s = 0\.0025: give whole milliseconds"),
        session(scenario, 1, TrafficSettings(step_s=0.0025)),
    ):
        pass


@pytest.mark.parametrize("begin_s", [1_000_003.0, 123_456.75, 1_732_518_000.0])
def test_sumo_begins_when_the_recording_does(tmp_path: Path, begin_s: float) -> None:
    """Every digit of `begin` reaches SUMO, so that the director and the states keep one time."""
    scenario = replace(load(straight_road(tmp_path / "road", vehicle("a", depart=begin_s + 1.0))), begin_s=begin_s)
    recording = record(scenario, 1, TrafficSettings(run_in_s=0.0, duration_s=4.0, **STEADY), NONE)
    assert recording.times(recording.tracks["a"])[0] == pytest.approx(begin_s + 1.01, abs=1e-6)
    assert recording.facts is not None
    assert (recording.facts.from_s, recording.facts.to_s) == (begin_s, begin_s + 4.0)


def test_a_begin_between_two_steps_is_refused(tmp_path: Path) -> None:
    scenario = replace(load(straight_road(tmp_path / "road", vehicle("a"))), begin_s=0.005)
    with pytest.raises(InputError, match=r"begins at 0\.005 s, which is no whole number of steps of 0\.01 s"):
        record(scenario, 1, SHORT, NONE)


def test_an_empty_span_names_the_first_departure(tmp_path: Path) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("late", depart=25_205.0)))
    facts = record(scenario, 1, TrafficSettings(run_in_s=1.0, duration_s=2.0), NONE).facts
    assert facts is not None
    assert (facts.from_s, facts.to_s, facts.recorded, facts.first_departure_s) == (1.0, 3.0, 0, 25_205.0)


def test_a_begin_after_all_of_the_demand_names_its_first_departure(tmp_path: Path) -> None:
    """A configuration that counts in Unix time, and a demand that does not."""
    flow = '<flow id="f" type="car" route="all" begin="1000003" end="9999999" period="2"/>'
    scenario = load(straight_road(tmp_path / "road", flow))
    facts = record(
        replace(scenario, begin_s=1_732_518_000.0), 1, TrafficSettings(run_in_s=1.0, duration_s=2.0), NONE
    ).facts
    assert facts is not None
    assert facts.recorded == 0
    (line,) = traffic_faults(traffic_summary([Episode(scenario="road", seed=1, traffic=facts)]))
    span = "no vehicle between 1,732,518,001 and 1,732,518,003 s in 1 of 1 episodes"
    assert line.startswith(f"road: {span}; the first departs at 1,000,003 s: set `begin`")


def test_vehicles_that_sumo_discards_are_counted(tmp_path: Path) -> None:
    """Ten cars a second into one lane, of which those give up that have no room within a second."""
    crowd = '<flow id="f" type="car" route="all" begin="0" end="20" period="0.1" departLane="0" departSpeed="0"/>'
    scenario = load(straight_road(tmp_path / "road", crowd + vehicle("future", depart=100.0)))
    impatient = replace(scenario, kept={"max-depart-delay": "1"})
    settings = TrafficSettings(run_in_s=0.0, duration_s=15.0)
    facts = [record(one, 1, settings, NONE).facts for one in (scenario, impatient)]
    assert all(fact is not None and fact.by_class == {"passenger": fact.vehicles} for fact in facts)
    assert facts[0] is not None
    assert facts[1] is not None
    assert facts[0].discarded == 0
    assert 150 - 1.5 * 10 <= facts[1].vehicles + facts[1].discarded <= 150


def test_vehicles_that_are_not_sorted_by_departure_drive(tmp_path: Path) -> None:
    """SUMO leaves out what departs before the one above it; a sorted copy lets all of them drive, as SUMO would."""
    cars = [vehicle(f"v{k}", depart=float(k), lane=k % 3) for k in range(6)]
    settings = TrafficSettings(run_in_s=0.0, duration_s=8.0, **STEADY)
    (in_order, shuffled) = (
        record(load(straight_road(tmp_path / name / "road", "\n".join(rows))), 1, settings, NONE)
        for name, rows in (("sorted", cars), ("shuffled", [cars[k] for k in (3, 0, 5, 1, 4, 2)]))
    )
    assert len(in_order.tracks) == 6
    assert same(in_order, shuffled)
    assert shuffled.facts is not None
    assert not shuffled.facts.warnings


def test_broken_demand_is_refused_in_one_line(tmp_path: Path) -> None:
    scenario = load(straight_road(tmp_path / "road", vehicle("a").replace('route="all"', 'route="nowhere"')))
    with pytest.raises(InputError, match=r"SUMO refuses scenario road \(.*nowhere.*\): fix its files") as caught:
        record(scenario, 1, SHORT, NONE)
    assert "\n" not in str(caught.value)


def test_the_reason_of_a_refusal_is_sumos_own(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A rerouter names a route that is defined only later: SUMO's exception says `Process Error`, and no more."""
    rerouter = (
        '<rerouter id="rr" edges="e0"><interval begin="0" end="9"><routeProbReroute id="all" probability="1"/>'
        "</interval></rerouter>"
    )
    scenario = load(straight_road(tmp_path / "road", vehicle("a"), additional=rerouter))
    with pytest.raises(InputError) as caught:
        record(scenario, 1, SHORT, NONE)
    reason = "rerouter 'rr': Alternative route 'all' does not exist"
    assert str(caught.value) == f"SUMO refuses scenario road ({reason}): fix its files"
    assert capfd.readouterr().err == ""


def test_warnings_are_counted_and_not_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """One car is driven into another: SUMO warns once of the collision."""
    cars = vehicle("ahead", lane=0, position=100.0) + vehicle("behind", depart=1.0, lane=0, position=20.0)
    warnings: list[SumoWarning] = []
    with session(load(str(straight_road(tmp_path / "r", cars, lanes=1))), 1, TrafficSettings(), warnings) as sumo:
        for _ in range(200):
            sumo.simulationStep()
        sumo.vehicle.setSpeedMode("behind", 0)
        sumo.vehicle.setSpeed("ahead", 0.0)
        sumo.vehicle.setSpeed("behind", 36.0)
        while not sumo.simulation.getCollisions():
            sumo.simulationStep()
        sumo.vehicle.remove("behind")
        sumo.simulationStep()
    assert any("collision with vehicle 'ahead'" in warning.example for warning in warnings)
    assert "Warning" not in capfd.readouterr().err
