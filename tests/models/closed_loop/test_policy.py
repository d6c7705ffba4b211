"""Who is told what on an alarm."""

from __future__ import annotations

from dataclasses import replace

import pytest

from isacsim.traffic.recording import Recording
from labeling.intentions import KNOWN
from labeling.road.straight_road import ScriptedVehicle, straight_road
from labeling.road.surroundings import Surroundings
from labeling.samples.uv_choice import PairSettings
from models.closed_loop.alarms import Alarm
from models.closed_loop.policy import POLICY, advisories

TIME_S = 2.0


@pytest.fixture(scope="module")
def surroundings() -> Surroundings:
    """A TV in the middle lane with vehicles all around it; the nearest ones are named after their place."""
    middle, width = 3.2, 3.2
    places = {
        "tv": (100.0, middle), "ahead": (140.0, middle), "far_ahead": (190.0, middle), "behind": (60.0, middle),
        "far_behind": (20.0, middle), "left": (97.0, middle + width), "left_behind": (50.0, middle + width),
        "left_ahead": (160.0, middle + width), "right": (70.0, middle - width),
    }  # fmt: skip
    return Surroundings(
        straight_road(
            *(
                ScriptedVehicle(name, 25.0, lateral=side, start_m=along, duration_s=4.0)
                for name, (along, side) in places.items()
            )
        )
    )


def sent(
    surroundings: Surroundings, intention: str, pairs: PairSettings, range_m: float = 100.0
) -> set[tuple[str, str]]:
    alarm = Alarm("tv", intention, TIME_S)
    return {(a.vehicle, a.instruction) for a in advisories(alarm, surroundings, pairs, range_m, 2.7)}


@pytest.mark.parametrize(
    ("intention", "expected"),
    [
        ("hard_brake", {("behind", "slow")}),
        ("left_lane_change", {("left", "open_gap"), ("behind", "hold_lane")}),
        ("overtake", {("left", "open_gap"), ("behind", "hold_lane")}),
        ("right_lane_change", {("right", "open_gap")}),
        ("evasive_swerve", {("behind", "slow"), ("left", "open_gap"), ("right", "open_gap")}),
        ("hard_accel", {("ahead", "hold_lane")}),
    ],
)
def test_those_whom_the_maneuver_endangers_are_told(
    surroundings: Surroundings, intention: str, expected: set[tuple[str, str]]
) -> None:
    assert sent(surroundings, intention, PairSettings()) == expected


def in_mirror(recording: Recording) -> Recording:
    """The same driving in the mirror, where traffic keeps left."""
    lanes = tuple(replace(lane, shape=lane.shape * [1.0, -1.0]) for lane in recording.lanes)
    tracks = {name: replace(track, y=-track.y, lane_lat=-track.lane_lat) for name, track in recording.tracks.items()}
    return replace(recording, lanes=lanes, tracks=tracks, lefthand=True)


@pytest.mark.parametrize("intention", POLICY)
def test_where_traffic_keeps_left_everything_is_mirrored(surroundings: Surroundings, intention: str) -> None:
    mirror = Surroundings(in_mirror(surroundings.recording))
    sides = {"left_lane_change": "right_lane_change", "right_lane_change": "left_lane_change"}
    there = sent(mirror, sides.get(intention, intention), PairSettings())
    # The vehicles keep their names: the one called "left" drives on the right there.
    assert there == sent(surroundings, intention, PairSettings())


def test_every_intention_has_a_policy() -> None:
    assert set(POLICY) == {known.text for known in KNOWN}


def test_only_connected_vehicles_within_range_are_told(surroundings: Surroundings) -> None:
    assert sent(surroundings, "evasive_swerve", PairSettings(connected_share=0.0)) == set()
    # The vehicle behind has its front 35 m behind the TV's rear; the one to the right is 30 m back.
    assert sent(surroundings, "evasive_swerve", PairSettings(), range_m=32.0) == {
        ("left", "open_gap"),
        ("right", "open_gap"),
    }


def test_an_alarm_about_a_vehicle_that_has_left_tells_nobody(surroundings: Surroundings) -> None:
    assert not advisories(Alarm("tv", "hard_brake", 100.0), surroundings, PairSettings(), 100.0, 100.7)
