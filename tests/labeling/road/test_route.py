"""The way that a vehicle still has before it: leaders stand on roads that it drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.route import Route, after
from isac_cosim.labeling.road.surroundings import Surroundings

SPEED_MPS = 10.0
LINKS = {
    "a_0": (":j_0_0", ":j_2_0"),
    "a_1": (":j_0_1", ":j_3_0"),
    ":j_0_0": ("b_0",),
    ":j_0_1": ("b_1",),
    ":j_2_0": ("exit_0",),
    ":j_3_0": (":j_4_0",),
    ":j_4_0": ("back_0",),
    "b_0": ("c_0",),
    "b_1": (),
    "exit_0": (),
    "back_0": ("a_0",),
    "c_0": (),
}
"""Edge a of two lanes leads to b, from its right lane to an exit, and from its left one by a U-turn to the opposite."""
SHAPE = np.zeros((2, 2))
LANES = tuple(
    Lane(name, name.rpartition("_")[0], int(name[-1]), 3.2, 10.0 if name.startswith(":") else 100.0, SHAPE, to)
    for name, to in LINKS.items()
)
NUMBER = {lane.id: k for k, lane in enumerate(LANES)}


def drive(
    vehicle: str, way: list[str], start_m: float = 0.0, onward: tuple[str, ...] | None = None, seconds: float = 40.0
) -> Track:
    """Return a drive over some lanes at constant speed, up to the end of the last one."""
    ends = np.cumsum([LANES[NUMBER[name]].length_m for name in way])
    s = start_m + SPEED_MPS * 0.01 * np.arange(round(seconds * 100))
    s = s[s < ends[-1]]
    n = np.searchsorted(ends, s, side="right")
    lane = np.array([NUMBER[name] for name in way])[n]
    pos = s - np.concatenate([[0.0], ends])[n]
    still = np.zeros(len(s))
    return Track(vehicle, "passenger", 5.0, 1.8, 0, s, still, still + SPEED_MPS, lane, pos, still, onward)


def leader(tv: Track, *others: Track, time: float = 0.0) -> str | None:
    recording = Recording("scripted", 1, 0.01, LANES, {track.vehicle: track for track in (tv, *others)})
    found = Surroundings(recording).leader(tv.vehicle, time, 100.0)
    return None if found is None else found.vehicle


AHEAD = drive("ahead", ["b_0"], 10.0)
EXITS = drive("exits", ["exit_0"], 5.0)
ONCOMING = drive("oncoming", ["back_0"], 5.0)


def test_a_leader_is_on_the_branch_that_is_driven_next() -> None:
    assert leader(drive("tv", ["a_0", ":j_0_0", "b_0"], 60.0), AHEAD, EXITS) == "ahead"
    assert leader(drive("tv", ["a_0", ":j_2_0", "exit_0"], 60.0), AHEAD, EXITS) == "exits"


@pytest.mark.parametrize("others", [(EXITS,), (AHEAD,), (AHEAD, EXITS, ONCOMING)])
@pytest.mark.parametrize("lane", ["a_0", "a_1"])
def test_where_nobody_knows_the_branch_there_is_no_leader_beyond_the_fork(lane: str, others: tuple[Track, ...]) -> None:
    """The track ends before the fork, and where the vehicle was going is not known."""
    assert leader(drive("tv", [lane], 60.0), *others) is None


def test_the_route_names_the_branch_that_the_recording_no_longer_shows() -> None:
    assert leader(drive("tv", ["a_0"], 60.0, ("a", "exit")), AHEAD, EXITS) == "exits"
    assert leader(drive("tv", ["a_0"], 60.0, ("b", "c")), AHEAD, EXITS) == "ahead"
    assert leader(drive("tv", ["a_0"], 60.0, ("b",)), drive("far", ["c_0"], 5.0), time=0.0) is None
    assert leader(drive("tv", ["a_0"], 60.0, ()), AHEAD, EXITS) is None


def test_beyond_the_end_of_its_route_a_vehicle_has_no_leader() -> None:
    """It arrives where b ends, although the road goes on."""
    beyond = drive("beyond", ["c_0"], 5.0)
    assert leader(drive("tv", ["a_0", ":j_0_0", "b_0"], 180.0, ()), beyond) is None
    assert leader(drive("tv", ["a_0", ":j_0_0", "b_0"], 180.0, ("b", "c")), beyond) == "beyond"
    # Where nothing is known of the route, a road that does not fork goes on.
    assert leader(drive("tv", ["a_0", ":j_0_0", "b_0"], 180.0), beyond) == "beyond"


def test_the_opposite_lane_was_driven_before_and_is_not_ahead() -> None:
    """The vehicle comes from the opposite lane, to which a U-turn leads back."""
    tv = drive("tv", ["back_0", "a_0", ":j_0_0", "b_0"], 60.0)
    assert leader(tv, drive("oncoming", ["back_0"], 5.0), time=12.0) is None
    turned = replace(drive("tv", ["a_1", ":j_3_0", ":j_4_0", "back_0"], 60.0))
    assert leader(turned, ONCOMING) == "oncoming"


def test_an_exit_lane_that_is_left_in_time_has_no_leader_on_the_exit() -> None:
    """The vehicle changes from the right lane to the left one; the right one of b is on its road, the exit is not."""
    first, rest = drive("tv", ["a_0"], 60.0), drive("tv", ["a_1", ":j_0_1", "b_1"], 90.0)
    lane = np.concatenate([first.lane[:300], rest.lane])
    tv = replace(
        rest, x=np.zeros(len(lane)), y=np.zeros(len(lane)), speed=np.full(len(lane), SPEED_MPS), lane=lane,
        lane_pos=np.concatenate([first.lane_pos[:300], rest.lane_pos]), lane_lat=np.zeros(len(lane)),
    )  # fmt: skip
    assert leader(tv, EXITS) is None
    assert leader(tv, EXITS, AHEAD) == "ahead"


def test_a_road_that_is_driven_again_later_is_ahead_only_then() -> None:
    """Round a block: the exit leads back to a, and the second time the vehicle takes it."""
    round_trip = Route(drive("tv", ["a_0", ":j_0_0", "b_0"], 0.0, ("b", "c", "back", "a", "exit")), LaneGraph(LANES))
    onward = {LANES[lane].id for lane, _ in round_trip.onward(NUMBER["a_0"], 0)}
    assert onward == {":j_0_0"}
    second = round_trip.driven + 2
    assert {LANES[lane].id for lane, _ in round_trip.onward(NUMBER["a_0"], second)} == {":j_2_0"}


def test_gaps_beyond_the_track_are_along_the_route() -> None:
    for onward, expected in ((("b",), [True, False]), (("exit",), [False, True]), (None, [False, False])):
        tv = drive("tv", ["a_0"], 60.0, onward)
        recording = Recording("scripted", 1, 0.01, LANES, {t.vehicle: t for t in (tv, AHEAD, EXITS)})
        around = Surroundings(recording)
        known = [bool(np.isfinite(around.gaps("tv", name, np.array([1.0]))[0])) for name in ("ahead", "exits")]
        assert known == expected


def test_what_was_driven_is_no_longer_ahead() -> None:
    assert after(["a", ":j"], ("a", "b", "c")) == ("b", "c")
    assert after(["a", ":j", "b"], ("a", "b", "c")) == ("c",)
    assert after([":j"], ("b", "c")) == ("b", "c")
    assert after(["a"], ()) == ()
