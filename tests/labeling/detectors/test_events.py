"""Precedence, provenance, and properties of the events of a whole recording."""

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.recordings.recording import Command, Recording
from isac_cosim.labeling.detectors.evasive_swerve import EvasiveSwerveSettings
from isac_cosim.labeling.detectors.events import Provenance, label, provenance
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep, thinned, total

ROAD = Road((Stretch(600.0), Stretch(5.0, internal=True), Stretch(400.0, (-1, 0, 1, 2)), Stretch(6000.0)), 0.0005)
SETTINGS = LabelSettings()


def kinds(recording: Recording, vehicle: str = "tv") -> list[str]:
    events = [event for event in label(recording, SETTINGS).events if event.vehicle == vehicle]
    return [event.intention.text for event in events if event.intention is not Intention.FOLLOWING]


def test_a_swerve_that_pokes_across_a_marking_is_a_swerve_alone() -> None:
    lateral = total(0.3, sweep(10.0, 1.4, 1.7), sweep(13.0, 1.4, -1.7))
    recording = record(ROAD, Drive("tv", lateral=lateral))
    labels = label(recording, SETTINGS)
    assert kinds(recording) == ["evasive_swerve"]
    assert labels.counts["within_swerve"] == len(labels.changes["tv"]) == 2


def test_a_swerve_that_ends_in_the_next_lane_is_a_swerve_alone() -> None:
    tv = Drive("tv", 0.0, 30.0, sweep(10.0, 2.0, WIDTH_M), 30.0)
    assert kinds(record(ROAD, tv, Drive("stopped", 360.0, 0.1, duration_s=60.0))) == ["evasive_swerve"]
    assert kinds(record(ROAD, tv)) == ["left_lane_change"]


@pytest.mark.parametrize(("gap_m", "threatened"), [(75.0, True), (85.0, False)])
def test_a_threat_is_a_leader_within_four_seconds_of_collision(gap_m: float, threatened: bool) -> None:
    """At 20 m/s more than the leader, 80 m between bumpers at the onset, about 10.2 s, are four seconds."""
    tv = Drive("tv", 0.0, 30.0, sweep(10.0, 2.0, WIDTH_M), 30.0)
    recording = record(ROAD, tv, Drive("slow", gap_m + 5.0 + 10.2 * 20.0, 10.0, duration_s=60.0))
    assert ("evasive_swerve" in kinds(recording)) is threatened


def test_a_brake_during_a_lane_change_keeps_both() -> None:
    speed = ramps((0, 30), (10.5, 30), (12.5, 18), (100, 18))
    recording = record(ROAD, Drive("tv", speed=speed, lateral=sweep(10.0, 4.0, WIDTH_M)))
    assert sorted(kinds(recording)) == ["hard_brake", "left_lane_change"]


def test_a_brake_during_a_swerve_keeps_both() -> None:
    speed = ramps((0, 30), (10, 30), (12, 18), (100, 18))
    lateral = total(sweep(10.0, 1.3, 1.3), sweep(11.5, 1.3, -1.3))
    assert sorted(kinds(record(ROAD, Drive("tv", speed=speed, lateral=lateral)))) == ["evasive_swerve", "hard_brake"]


def busy(commands: tuple[Command, ...] = ()) -> Recording:
    """Traffic with every intention at least once."""
    out_and_back = total(sweep(12.0, 4.0, WIDTH_M), sweep(24.0, 4.0, -WIDTH_M))
    evades = total(WIDTH_M, sweep(20.0, 1.2, 1.2), sweep(21.5, 1.2, -1.2))
    return record(
        ROAD,
        Drive("tv", 0.0, 32.0, out_and_back, 70.0),
        Drive("uv", 110.0, 24.0, 0.0, 70.0),
        Drive("brakes", 400.0, ramps((0, 30), (20, 30), (22, 18), (30, 18), (33, 29), (99, 29)), duration_s=70.0),
        Drive("evades", 700.0, 30.0, evades, 70.0),
        Drive("follows", 640.0, 30.0, 2 * WIDTH_M, 70.0, kind="truck", length_m=12.0),
        Drive("leads", 690.0, 30.0, lambda t: 2 * WIDTH_M + sweep(50.0, 4.0, -WIDTH_M)(t), 70.0),
        commands=commands,
    )


def test_every_intention_is_found_in_one_recording() -> None:
    events = label(busy(), SETTINGS).events
    assert {event.intention for event in events} == set(Intention) - {Intention.LEFT_LANE_CHANGE}
    assert [event.onset for event in events] == sorted(event.onset for event in events)
    assert all(event.onset <= event.commit <= event.end for event in events)


COMMANDS = (Command("brakes", "hard_brake", 19.5, 23.0), Command("uv", "slow_vehicle", 0.0, 60.0))


def test_labels_do_not_depend_on_commands() -> None:
    recording = busy(COMMANDS)
    events = label(recording, SETTINGS).events
    assert label(replace(recording, commands=()), SETTINGS).events == events


def test_the_origin_follows_from_the_commands_to_the_same_vehicle() -> None:
    recording = busy(COMMANDS)
    maneuvers = [event for event in label(recording, SETTINGS).events if event.intention is not Intention.FOLLOWING]
    origins = {(event.vehicle, event.intention): provenance(recording, event).origin for event in maneuvers}
    assert origins["brakes", Intention.HARD_BRAKE] == "commanded"
    assert origins["brakes", Intention.HARD_ACCEL] == "natural"
    assert origins["tv", Intention.OVERTAKE] == "natural"


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [(0.0, 18.9, "natural"), (0.0, 19.1, "commanded"), (21.9, 30.0, "commanded"), (22.1, 30.0, "natural")],
)
def test_origin_reaches_from_a_second_before_onset_to_the_end(start: float, end: float, expected: str) -> None:
    recording = replace(busy(), commands=(Command("v", "m", start, end),))
    assert provenance(recording, Event("v", Intention.HARD_BRAKE, 20.0, 20.5, 22.0, -6.0)).origin == expected


def test_what_follows_the_pulling_out_does_not_make_an_overtake() -> None:
    """An overtake ends with the return, half a minute later; its record ends long before."""
    overtake = Event("v", Intention.OVERTAKE, 20.0, 22.0, 45.0, 1.0, motion_end=25.0)
    for start, expected in ((24.9, "commanded"), (25.1, "natural")):
        recording = replace(busy(), commands=(Command("v", "m", start, 40.0),))
        assert provenance(recording, overtake).origin == expected


def test_thinned_to_20_hz_the_events_are_the_same() -> None:
    events_at_100_hz = label(busy(), SETTINGS).events
    events_at_20_hz = label(thinned(busy(), 5), SETTINGS).events
    for fine, coarse in zip(events_at_100_hz, events_at_20_hz, strict=True):
        assert (coarse.vehicle, coarse.intention, coarse.other) == (fine.vehicle, fine.intention, fine.other)
        assert (coarse.onset, coarse.commit, coarse.end) == pytest.approx((fine.onset, fine.commit, fine.end), abs=0.1)
        assert coarse.peak == pytest.approx(fine.peak, abs=0.1)


def test_thresholds_are_settings() -> None:
    strict = LabelSettings(preset="strict", evasive_swerve=EvasiveSwerveSettings(threshold_mps2=9.0))
    assert label(busy(), strict).of(Intention.EVASIVE_SWERVE) == []
    assert label(busy(), strict).settings.preset == "strict"


def test_a_vehicle_seen_for_a_moment_has_no_events() -> None:
    recording = record(ROAD, Drive("tv", duration_s=0.0), Drive("other", duration_s=0.5))
    assert label(recording, SETTINGS).events == ()


@pytest.mark.parametrize(
    ("brake", "over_s", "beyond"), [(8.0, 0.5, 0), (11.0, 1.0, 1), (8.5, 0.01, 0), (14.0, 0.01, 1)]
)
def test_motion_beyond_what_a_car_can_do_is_counted(brake: float, over_s: float, beyond: int) -> None:
    """Too much is more than 9 m/s2, or a step: the kernel turns a step of a into a jerk of a / (0.15 s sqrt(2 pi))."""
    t = np.arange(0.0, 12.01, 0.01)
    acceleration = -np.interp(t, [4.0, 4.0 + over_s, 5.0 + over_s, 5.0 + 2 * over_s], [0.0, brake, brake, 0.0])
    speed = 30.0 + np.concatenate([[0.0], np.cumsum(acceleration[1:] + acceleration[:-1]) * 0.005])
    recording = record(Road(), Drive("tv", speed=lambda _: speed, duration_s=12.0))
    assert label(recording, LabelSettings()).counts["beyond_car"] == beyond


def test_the_last_of_several_commands_says_why() -> None:
    """A reaction has its cause and time to collision; a command, or a reaction without need, has neither."""
    commands = (
        Command("v", "hard_accel", 10.0, 19.5, "gap_ahead"),
        Command("v", "evasion", 19.4, 24.0, "debris", 1.8),
        Command("other", "hard_brake", 20.0, 22.0),
    )
    event = Event("v", Intention.EVASIVE_SWERVE, 20.0, 20.5, 22.0, -6.0)

    def of(*noted: Command) -> Provenance:
        return provenance(Recording("s", 1, 0.01, (), {}, noted), event)

    assert of(*commands) == Provenance("reaction", "debris", 1.8)
    without_ttc = of(commands[0])
    assert (without_ttc.origin, without_ttc.cause) == ("reaction", "gap_ahead")
    assert np.isnan(without_ttc.cause_ttc_s)
    assert of(*commands, Command("v", "evasion", 21.0, 23.0)).origin == "commanded"
    assert of(commands[2]).origin == "natural"
