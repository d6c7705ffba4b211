"""Gaps, leaders and relations between vehicles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.surroundings import Surroundings
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, record, sweep

SPLIT = Road((Stretch(400.0), Stretch(8.0, internal=True), Stretch(300.0, (-1, 0, 1, 2)), Stretch(3000.0)))


@given(ahead=st.floats(-150.0, 150.0), begin=st.floats(0.0, 3.0), time=st.floats(4.0, 28.0))
@settings(max_examples=30, deadline=None)
def test_gap_along_the_road_is_the_distance_driven_apart(ahead: float, begin: float, time: float) -> None:
    """Over edges, junction lanes and renumbered lanes; also before the first and after the last driven edge."""
    recording = record(
        SPLIT,
        Drive("tv", 300.0, 28.0, lateral=sweep(5.0, 4.0, WIDTH_M), duration_s=30),
        Drive("other", 300.0 + ahead, 31.0, lateral=2 * WIDTH_M, duration_s=30, begin_s=round(begin, 2)),
    )
    time = round(time, 2)
    (gap,) = Surroundings(recording).gaps("tv", "other", np.array([time]))
    expected = ahead + 31.0 * (time - round(begin, 2)) - 28.0 * time
    assert gap == pytest.approx(expected, abs=0.35)  # 1 cm of time is 0.3 m of road


@pytest.mark.parametrize("ahead", [-280.0, -60.0, 60.0, 200.0, 500.0])
def test_gap_reaches_beyond_the_edges_that_are_driven(ahead: float) -> None:
    """The vehicle is only on the third edge; the other one is on an edge before or after it."""
    recording = record(
        SPLIT, Drive("tv", 500.0, 20.0, duration_s=5.0), Drive("uv", 500.0 + ahead, 20.0, duration_s=5.0)
    )
    (gap,) = Surroundings(recording).gaps("tv", "uv", np.array([3.0]))
    assert gap == pytest.approx(ahead, abs=1e-6)


def test_gap_over_junction_lanes_so_short_that_no_row_lies_on_them() -> None:
    joints = tuple(Stretch(1.2, internal=True) for _ in range(3))
    road = Road((Stretch(101.0), *joints, Stretch(2000.0)))
    fast = (Drive("tv", 0.0, 100.0, duration_s=5.0), Drive("uv", 250.0, 100.0, duration_s=5.0))
    surroundings = Surroundings(record(road, *fast, step_s=0.05))
    assert np.allclose(surroundings.gaps("tv", "uv", np.arange(0.0, 5.0, 0.05)), 250.0)


def test_lanes_through_one_junction_on_edges_of_their_own_are_one_road() -> None:
    shape = np.zeros((2, 2))
    lanes = (
        Lane("a_0", "a", 0, 3.2, 100.0, shape, (":j_0_0",)),
        Lane("a_1", "a", 1, 3.2, 100.0, shape, (":j_1_0",)),
        Lane(":j_0_0", ":j_0", 0, 3.2, 10.0, shape, ("b_0",)),
        Lane(":j_1_0", ":j_1", 0, 3.2, 20.0, shape, ("b_1",)),
        Lane("b_0", "b", 0, 3.2, 100.0, shape, ()),
        Lane("b_1", "b", 1, 3.2, 100.0, shape, ()),
    )

    def track(name: str, start: float, along: tuple[int, int, int]) -> Track:
        s = start + np.arange(1001) * 0.15
        ends = np.cumsum([lanes[k].length_m for k in along])
        n = np.minimum(np.searchsorted(ends, s, side="right"), 2)
        pos = s - np.concatenate([[0.0], ends])[n]
        return Track(
            name, "passenger", 5.0, 1.8, 0, s, 0 * s, 0 * s + 15, np.array(along)[n].astype(np.int32), pos, 0 * s
        )

    tracks = (track("tv", 20.0, (0, 2, 4)), track("uv", 50.0, (1, 3, 5)))
    surroundings = Surroundings(Recording("scripted", 1, 0.01, lanes, {t.vehicle: t for t in tracks}))
    # At 4 s the other vehicle is halfway along its junction lane of 20 m, which maps to halfway along the 10 m.
    assert surroundings.gaps("tv", "uv", np.array([4.0])) == pytest.approx([105.0 - 80.0])
    assert surroundings.gaps("tv", "uv", np.array([6.0])) == pytest.approx([20.0])


def test_gap_is_unknown_where_the_other_is_absent() -> None:
    recording = record(SPLIT, Drive("tv"), Drive("other", 50.0, begin_s=10.0, duration_s=5.0))
    gaps = Surroundings(recording).gaps("tv", "other", np.array([5.0, 12.0, 20.0]))
    assert np.isnan(gaps).tolist() == [True, False, True]


def test_leader_is_the_next_in_the_lane_over_edges() -> None:
    recording = record(
        SPLIT,
        Drive("tv", 350.0, 20.0),
        Drive("beside", 360.0, 20.0, lateral=WIDTH_M),
        Drive("next", 430.0, 20.0, length_m=12.0),
        Drive("far", 470.0, 20.0),
    )
    surroundings = Surroundings(recording)
    leader = surroundings.leader("tv", 0.0, 100.0)
    assert leader is not None
    assert (leader.vehicle, leader.gap_m) == ("next", pytest.approx(80.0 - 12.0))
    assert surroundings.leader("tv", 0.0, 60.0) is None
    assert surroundings.leader("far", 0.0, 100.0) is None
    second = surroundings.leader("next", 0.0, 100.0)
    assert second is not None
    assert second.vehicle == "far"


def fork() -> Recording:
    """One lane that forks; the vehicle and `same` take c, `exits` takes d."""
    shape = np.zeros((2, 2))
    lanes = (
        Lane("a_0", "a", 0, 3.2, 100.0, shape, ("c_0", "d_0")),
        Lane("c_0", "c", 0, 3.2, 100.0, shape, ()),
        Lane("d_0", "d", 0, 3.2, 100.0, shape, ()),
    )

    def track(name: str, start: float, branch: int) -> Track:
        s = start + np.arange(401) * 0.1
        lane = np.where(s < 100, 0, branch).astype(np.int32)
        pos = np.where(s < 100, s, s - 100)
        return Track(name, "passenger", 5.0, 1.8, 0, s, 0 * s, np.full(401, 10.0), lane, pos, 0 * s)

    tracks = (track("tv", 80.0, 1), track("exits", 105.0, 2), track("same", 120.0, 1))
    return Recording("scripted", 1, 0.01, lanes, {t.vehicle: t for t in tracks})


def test_at_a_fork_the_leader_is_on_the_branch_that_is_driven() -> None:
    surroundings = Surroundings(fork())
    leader = surroundings.leader("tv", 0.0, 100.0)
    assert leader is not None
    assert leader.vehicle == "same"
    assert np.isnan(surroundings.gaps("tv", "exits", np.array([0.0])))[0]
    assert surroundings.relation("tv", "exits", 0.0) is None


@pytest.mark.parametrize(
    ("start", "lateral", "relation"),
    [(60.0, 0, "ahead"), (-60.0, 0, "behind"), (60.0, 1, "left"), (-60.0, 1, "left"), (60.0, -1, "right")],
)
def test_relation(start: float, lateral: int, relation: str) -> None:
    recording = record(
        SPLIT,
        Drive("tv", 380.0, lateral=WIDTH_M, duration_s=2.0),
        Drive("uv", 380.0 + start, lateral=(1 + lateral) * WIDTH_M, duration_s=2.0),
    )
    assert Surroundings(recording).relation("tv", "uv", 1.0) == relation


def test_the_oncoming_carriageway_is_another_road() -> None:
    road = record(Road(), Drive("tv", 100.0), Drive("twin", 120.0))
    back = list(road.lanes)
    back.append(Lane("back_0", "back", 0, 3.2, 5000.0, np.zeros((2, 2)), ()))
    twin = road.tracks["twin"]
    oncoming = Track(
        "twin", "passenger", 5.0, 1.8, 0, twin.x, twin.y + 4, twin.speed, twin.lane * 0 + 3, twin.lane_pos, twin.y
    )
    surroundings = Surroundings(
        Recording("scripted", 1, 0.01, tuple(back), {"tv": road.tracks["tv"], "twin": oncoming})
    )
    assert surroundings.relation("tv", "twin", 1.0) is None
    assert surroundings.leader("tv", 1.0, 100.0) is None
