"""Precedence, provenance, and what the pass over a recording as a whole must keep."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from isacsim.traffic.recording import Command, Recording
from labeling.detectors.evasive_swerve import EvasiveSwerveSettings
from labeling.events import LabelSettings, label, origin
from labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep, thinned, total

ROAD = Road((Stretch(600.0), Stretch(5.0, internal=True), Stretch(400.0, (-1, 0, 1, 2)), Stretch(6000.0)), 0.0005)
SETTINGS = LabelSettings()


def kinds(recording: Recording, vehicle: str = "tv") -> list[str]:
    events = label(recording, SETTINGS).events
    return [e.intention.text for e in events if e.vehicle == vehicle and e.intention is not Intention.FOLLOWING]


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
    """20 m/s faster: 80 m between bumpers at the onset, about 10.2 s, are four seconds."""
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
    """Every intention once or more."""
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
    assert {e.intention for e in events} == set(Intention) - {Intention.LEFT_LANE_CHANGE}
    assert [e.onset for e in events] == sorted(e.onset for e in events)
    assert all(e.onset <= e.commit <= e.end for e in events)


COMMANDS = (Command("brakes", "hard_brake", 19.5, 23.0), Command("uv", "slow_vehicle", 0.0, 60.0))


def test_labels_do_not_look_at_commands_and_survive_the_disk(tmp_path: Path) -> None:
    recording = busy(COMMANDS)
    recording.save(tmp_path / "made.npz")
    events = label(recording, SETTINGS).events
    assert label(Recording.load(tmp_path / "made.npz"), SETTINGS).events == events
    assert label(replace(recording, commands=()), SETTINGS).events == events


def test_origin_is_told_by_the_vehicle_s_own_commands() -> None:
    recording = busy(COMMANDS)
    events = label(recording, SETTINGS).events
    told = {(e.vehicle, e.intention): origin(recording, e) for e in events if e.intention is not Intention.FOLLOWING}
    assert told["brakes", Intention.HARD_BRAKE] == "stimulated"
    assert told["brakes", Intention.HARD_ACCEL] == "natural"
    assert told["tv", Intention.OVERTAKE] == "natural"


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [(0.0, 18.9, "natural"), (0.0, 19.1, "stimulated"), (21.9, 30.0, "stimulated"), (22.1, 30.0, "natural")],
)
def test_origin_reaches_from_a_second_before_onset_to_the_end(start: float, end: float, expected: str) -> None:
    recording = replace(busy(), commands=(Command("v", "m", start, end),))
    assert origin(recording, Event("v", Intention.HARD_BRAKE, 20.0, 20.5, 22.0, -6.0)) == expected


def test_thinned_to_20_hz_the_events_are_the_same() -> None:
    fine, coarse = (label(r, SETTINGS).events for r in (busy(), thinned(busy(), 5)))
    assert [(e.vehicle, e.intention, e.other) for e in fine] == [(e.vehicle, e.intention, e.other) for e in coarse]
    for a, b in zip(fine, coarse, strict=True):
        assert (b.onset, b.commit, b.end) == pytest.approx((a.onset, a.commit, a.end), abs=0.1)
        assert b.peak == pytest.approx(a.peak, abs=0.1)


def test_thresholds_are_settings() -> None:
    loose = LabelSettings(preset="mine", evasive_swerve=EvasiveSwerveSettings(threshold_mps2=9.0))
    assert label(busy(), loose).of(Intention.EVASIVE_SWERVE) == []
    assert label(busy(), loose).settings.preset == "mine"


def test_a_preset_s_name_stands_for_its_values() -> None:
    assert LabelSettings.model_validate(LabelSettings().model_dump(mode="json")) == LabelSettings()
    for changed in ({"width_s": 0.2}, {"hard_brake": {"hold_s": 0.4}}):
        with pytest.raises(ValidationError, match="not that of preset isac-1"):
            LabelSettings.model_validate(changed)
        assert LabelSettings.model_validate({"preset": "mine", **changed}) != LabelSettings()


def test_a_vehicle_seen_for_a_moment_has_no_events() -> None:
    recording = record(ROAD, Drive("tv", duration_s=0.0), Drive("other", duration_s=0.5))
    assert label(recording, SETTINGS).events == ()


@pytest.mark.parametrize(
    ("brake", "over_s", "beyond"), [(8.0, 0.5, 0), (11.0, 1.0, 1), (8.5, 0.01, 0), (14.0, 0.01, 1)]
)
def test_motion_beyond_what_a_car_can_do_is_counted(brake: float, over_s: float, beyond: int) -> None:
    """More than 9 m/s2 held; or set in at once: a step of a through the kernel is a / (0.15 s sqrt(2 pi)) = 2.7 a."""
    t = np.arange(0.0, 12.01, 0.01)
    acceleration = -np.interp(t, [4.0, 4.0 + over_s, 5.0 + over_s, 5.0 + 2 * over_s], [0.0, brake, brake, 0.0])
    speed = 30.0 + np.concatenate([[0.0], np.cumsum(acceleration[1:] + acceleration[:-1]) * 0.005])
    recording = record(Road(), Drive("tv", speed=lambda _: speed, duration_s=12.0))
    assert label(recording, LabelSettings()).counts["beyond_car"] == beyond
