"""Who is told what on an alarm."""

from __future__ import annotations

from dataclasses import replace

import pytest

from isac_cosim.evaluation.closed_loop.policy import POLICY, advisories
from isac_cosim.evaluation.in_traffic.alarms.stream import Alarm
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import PairSettings
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, record

TIME_S = 2.0


PLACES = {
    "tv": (100.0, 1), "ahead": (140.0, 1), "far_ahead": (190.0, 1), "behind": (60.0, 1), "far_behind": (20.0, 1),
    "left": (97.0, 2), "left_behind": (50.0, 2), "left_ahead": (160.0, 2), "right": (70.0, 0),
}  # fmt: skip
"""The places along the road, m, and the lanes of a TV in the middle and of vehicles all around it."""


@pytest.fixture(scope="module")
def surroundings() -> Surroundings:
    """A TV with vehicles all around it; the nearest ones are named after their place."""
    return Surroundings(
        straight_road(
            *(
                ScriptedVehicle(name, 25.0, lateral=3.2 * lane, start_m=along, duration_s=4.0)
                for name, (along, lane) in PLACES.items()
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


@pytest.mark.parametrize("intention", sorted(POLICY))
@pytest.mark.parametrize("passed_m", [2.0, 4.0, 30.0, 60.0])
def test_where_the_road_is_divided_into_edges_changes_nothing(
    surroundings: Surroundings, intention: str, passed_m: float
) -> None:
    """The TV has passed the beginning of an edge; whoever is farther behind is on the edges before it."""
    begin_m = PLACES["tv"][0] + 25.0 * TIME_S - passed_m
    road = Road((Stretch(begin_m - 8.0), Stretch(8.0, internal=True), Stretch(2000.0)))
    drives = (
        Drive(name, along, 25.0, lane * WIDTH_M, duration_s=4.0, length_m=4.0) for name, (along, lane) in PLACES.items()
    )
    divided = Surroundings(record(road, *drives))
    assert sent(divided, intention, PairSettings()) == sent(surroundings, intention, PairSettings())


def test_behind_a_lane_that_begins_a_vehicle_is_behind_the_tv_and_not_beside_it() -> None:
    """The left lane begins 15 m behind the TV, as a branch of the TV's own lane."""
    road = Road((Stretch(135.0, slots=(1,)), Stretch(2000.0, slots=(1, 2))))
    lanes = list(road.lanes())
    lanes[0] = replace(lanes[0], successors=(lanes[1].id, lanes[2].id))
    recording = record(
        road, *(Drive(name, PLACES[name][0], 25.0, WIDTH_M, duration_s=4.0) for name in ("tv", "behind"))
    )
    around = Surroundings(replace(recording, lanes=tuple(lanes)))
    assert sent(around, "left_lane_change", PairSettings()) == {("behind", "hold_lane")}


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
