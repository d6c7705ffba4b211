"""Motion along the road: in the plane, a vehicle speeds up and slows down as SUMO says that it does."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array, ComplexArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.motion import MotionSettings, condition, excess, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.road_motion import road_motion
from isac_cosim.labeling.samples.candidates import RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings
from tests.support.drives import WIDTH_M, ramps, sweep

STEP = 0.01
LIMIT_MPS2 = 0.5


def lane(name: str, shape: ComplexArray, length_m: float, successors: tuple[str, ...] = ()) -> Lane:
    """Return a lane `<edge>_<index>` along some points."""
    edge, _, index = name.rpartition("_")
    points = np.stack([shape.real, shape.imag], axis=1)
    return Lane(name, edge, int(index), WIDTH_M, length_m, points, successors)


def place(where: Lane, lane_pos: Array, lane_lat: Array) -> ComplexArray:
    """Return where SUMO puts a vehicle: at its share of the shape's length, and aside from there."""
    shape = where.shape @ np.array([1.0, 1.0j])
    stations = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(shape)))])
    at = lane_pos * stations[-1] / where.length_m
    segment = np.clip(np.searchsorted(stations, at, side="right") - 1, 0, len(shape) - 2)
    heading = np.exp(1j * np.angle(np.diff(shape)))[segment]
    return np.asarray(np.interp(at, stations, shape) + 1j * heading * lane_lat)


def driven(lanes: tuple[Lane, ...], edges: tuple[str, ...], speed: Array, lateral: Array) -> Recording:
    """Return a drive over some edges.

    lateral: of the vehicle at each row, m left of lane 0. On an edge of a single lane, it is the offset from that lane.
    """
    of_edge = {edge: [k for k, one in enumerate(lanes) if one.edge == edge] for edge in edges}
    ends = np.cumsum([lanes[of_edge[edge][0]].length_m for edge in edges])
    along = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2.0 * STEP)])
    count = int(np.searchsorted(along, ends[-1]))
    along, speed, lateral = along[:count], speed[:count], lateral[:count]
    on = np.searchsorted(ends, along, side="right")
    lane_pos = along - np.concatenate([[0.0], ends])[on]
    index = np.floor(lateral / WIDTH_M + 0.5).astype(int)
    number = np.array(
        [of_edge[edges[e]][k if len(of_edge[edges[e]]) > 1 else 0] for e, k in zip(on, index, strict=True)]
    )
    lane_lat = np.array([lateral[k] - WIDTH_M * lanes[number[k]].index for k in range(count)])
    xy = np.empty(count, np.complex128)
    for k in np.unique(number):
        rows = number == k
        xy[rows] = place(lanes[k], lane_pos[rows], lane_lat[rows])
    track = Track(
        "tv", "passenger", 5.0, 1.8, 0,
        xy.real.copy(), xy.imag.copy(), speed, number.astype(np.int32), lane_pos, lane_lat,
    )  # fmt: skip
    return Recording("scripted", 1, STEP, lanes, {"tv": track})


def bent(radius_m: float, straight_m: float, turn_deg: float) -> tuple[Lane, Lane]:
    """Return two lanes of an edge that bends to the left, and then goes straight on.

    Both have one length in SUMO; the left lane's shape is shorter.
    """
    turn = np.radians(turn_deg)
    angles = np.linspace(0.0, turn, 9)
    shapes = []
    for k in (0, 1):
        arc = 1j * radius_m + (radius_m - k * WIDTH_M) * np.exp(1j * (angles - np.pi / 2))
        shapes.append(np.concatenate([arc, [arc[-1] + straight_m * np.exp(1j * turn)]]))
    length = float(np.abs(np.diff(shapes[0])).sum())
    return lane("road_0", shapes[0], length), lane("road_1", shapes[1], length)


def sideways(connection_m: float, aside_m: float, ahead_m: float) -> tuple[Lane, ...]:
    """Return two edges, the second one aside of the first, and the lane in the junction that joins them.

    connection_m: its length in SUMO. ahead_m: how far ahead it leads while it leads aside.
    """
    start, end = 300.0 + 0j, 300.0 + ahead_m + 1j * aside_m
    return (
        lane("before_0", np.array([0.0, start]), 300.0, (":j_0",)),
        lane(":j_0", np.array([start, start + 0.3 * ahead_m, end - 0.3 * ahead_m, end]), connection_m, ("after_0",)),
        lane("after_0", np.array([end, end + 500.0]), 500.0),
    )


def astray_mps2(recording: Recording, motion: MotionSettings) -> Array:
    """Return how far the acceleration in the plane, along the path, is from that of SUMO's speed, m/s2, (n,).

    Measured on the speed in the plane, which equals that along the road where the vehicle keeps its offset, to a few
    thousandths where it changes lanes in some seconds.
    """
    track = recording.tracks["tv"]
    times = recording.times(track)[150:-150]
    _, _, vx, vy, ax, ay = states(recording, track, times, motion)
    said = condition(track.speed, STEP, motion.width_s, 1)[150:-150]
    return np.asarray((vx * ax + vy * ay) / np.hypot(vx, vy) - said)


def steady(mps: float) -> Array:
    return np.full(20_000, mps)


def lane_change(at_s: float, left: bool = True) -> Array:
    """Return a lane change of 5 s to the left, or to the right, that begins at some time."""
    move = sweep(at_s, 5.0, WIDTH_M)(np.arange(20_000) * STEP)
    return np.asarray(move if left else WIDTH_M - move)


@pytest.mark.parametrize("left", [True, False])
def test_a_lane_change_between_lanes_of_different_length_neither_brakes_nor_accelerates(left: bool) -> None:
    """Past the bend, the left lane is 3.2 m x 60 degrees shorter: the change moves the vehicle along by 0.4 of that."""
    recording = driven(bent(120.0, 300.0, 60.0), ("road",), steady(20.0), lane_change(9.0, left))
    track = recording.tracks["tv"]
    row = int(np.flatnonzero(np.diff(track.lane))[0])
    jump = abs(np.hypot(track.x[row + 1] - track.x[row], track.y[row + 1] - track.y[row]))
    assert abs(jump - 0.2) > 0.3
    assert np.abs(astray_mps2(recording, MotionSettings(max_shift_m=0.0))).max() > 3.0
    assert np.abs(astray_mps2(recording, MotionSettings())).max() < LIMIT_MPS2
    assert len(excess(recording, track, MotionSettings(), along_mps2=LIMIT_MPS2).along) == 0


@pytest.mark.parametrize(("connection_m", "aside_m"), [(6.0, -1.6), (6.0, 1.2), (5.0, -1.6)])
def test_a_connection_that_leads_sideways_does_not_brake_a_vehicle(connection_m: float, aside_m: float) -> None:
    recording = driven(sideways(connection_m, aside_m, 4.0), ("before", ":j", "after"), steady(29.5), np.zeros(20_000))
    track = recording.tracks["tv"]
    raw, rounded = (
        states(recording, track, np.arange(8.0, 13.0, STEP), road)
        for road in (MotionSettings(max_shift_m=0.0), MotionSettings())
    )
    assert np.hypot(raw[2], raw[3]).min() < 27.5
    assert np.hypot(rounded[2], rounded[3]).min() > 28.5
    assert np.abs(astray_mps2(recording, MotionSettings())).max() < LIMIT_MPS2
    assert len(excess(recording, track, MotionSettings(), along_mps2=LIMIT_MPS2).along) == 0


def test_a_connection_too_far_aside_is_named() -> None:
    """To go 3.2 m aside, the road would have to be moved by more than it may be."""
    recording = driven(sideways(6.0, 3.2, 4.0), ("before", ":j", "after"), steady(29.5), np.zeros(20_000))
    beyond = excess(recording, recording.tracks["tv"], MotionSettings(), along_mps2=LIMIT_MPS2)
    assert np.abs(beyond.along - 302.0 / 29.5).max() < 1.0
    assert len(beyond.along)


def test_a_right_angle_at_walking_pace_does_not_slow_a_vehicle_down() -> None:
    """The rounded corner is shorter than the one on which SUMO measures the way."""
    corner = lane("road_0", np.array([0.0, 150.0, 150.0 + 150.0j]), 300.0)
    recording = driven((corner,), ("road",), steady(2.0), np.zeros(20_000))
    track = recording.tracks["tv"]
    raw, rounded = (
        states(recording, track, np.arange(70.0, 80.0, STEP), road)
        for road in (MotionSettings(max_shift_m=0.0), MotionSettings())
    )
    assert np.hypot(raw[2], raw[3]).min() < 1.5
    assert np.hypot(rounded[2], rounded[3]).min() > 1.7
    assert np.abs(astray_mps2(recording, MotionSettings())).max() < LIMIT_MPS2


def test_a_lane_change_in_a_standing_queue_is_spread_over_the_way_driven() -> None:
    """The vehicle stands while its lane changes; it moves along the road only when it drives."""
    speed = np.asarray(ramps((0, 12), (10, 12), (14, 0), (24, 0), (30, 12), (100, 12))(np.arange(20_000) * STEP))
    recording = driven(bent(60.0, 300.0, 60.0), ("road",), speed, lane_change(16.0))
    track = recording.tracks["tv"]
    assert track.speed[np.flatnonzero(np.diff(track.lane))[0]] == 0.0
    times = np.arange(15.0, 23.0, STEP)
    _, _, vx, vy, _, _ = states(recording, track, times, MotionSettings())
    along = np.exp(-1j * np.radians(60.0)) * (vx + 1j * vy)
    assert np.abs(along.real).max() < 0.02
    assert len(excess(recording, track, MotionSettings(), along_mps2=LIMIT_MPS2).along) == 0


def test_the_hard_brake_of_a_lane_changer_is_the_same_in_the_plane_as_for_its_label() -> None:
    speed = np.asarray(ramps((0, 20), (11, 20), (12.0, 17), (14.0, 5), (100, 5))(np.arange(20_000) * STEP))
    recording = driven(bent(120.0, 300.0, 60.0), ("road",), speed, lane_change(9.5))
    (event,) = [e for e in label(recording, LabelSettings()).events if e.intention.text == "hard_brake"]
    state = states(recording, recording.tracks["tv"], np.array([event.commit]), MotionSettings())[:, 0]
    assert (state[2] * state[4] + state[3] * state[5]) / np.hypot(*state[2:4]) == pytest.approx(-4.0, abs=0.3)


@settings(max_examples=40, deadline=None)
@given(
    radius=st.floats(60.0, 400.0),
    turn=st.floats(5.0, 80.0),
    share=st.floats(0.6, 1.0),
    left=st.booleans(),
    at_s=st.floats(2.0, 12.0),
)
def test_motion_agrees_with_the_speed_or_is_named(
    radius: float, turn: float, share: float, left: bool, at_s: float
) -> None:
    """Wherever the speed in the plane is not SUMO's, the times are among those of `excess`.

    share: of the speed with which the bend takes 4 m/s2; on a sharper one, the path would not be along the road.
    """
    speed = share * float(np.sqrt(4.0 * radius))
    recording = driven(bent(radius, 300.0, turn), ("road",), steady(speed), lane_change(at_s, left))
    track = recording.tracks["tv"]
    times = recording.times(track)[150:-150]
    beyond = excess(recording, track, MotionSettings(), along_mps2=LIMIT_MPS2).along
    astray = times[np.abs(astray_mps2(recording, MotionSettings())) > LIMIT_MPS2 + 0.1]
    assert all(np.abs(beyond - time).min(initial=np.inf) < 0.3 for time in astray)


def test_a_vehicle_that_sumo_moves_by_metres_is_left_out_as_along() -> None:
    """More than the road may be moved: the times are named, and records that hold them are left out and counted."""
    road = lane("road_0", np.array([0.0, 4000.0]), 4000.0)
    brake = np.asarray(ramps((0, 25), (20, 25), (22, 13), (200, 13))(np.arange(20_000) * STEP))
    tv = driven((road,), ("road",), brake, np.zeros(20_000)).tracks["tv"]
    uv = replace(tv, vehicle="uv", x=tv.x + 40.0, lane_pos=tv.lane_pos + 40.0)
    rows = np.arange(len(tv))
    for moved_m, left_out in ((0.0, 0), (1.0, 0), (6.0, 1)):
        moved = replace(tv, x=tv.x + np.where(rows >= 2150, moved_m, 0.0))
        recording = Recording("scripted", 1, STEP, (road,), {"tv": moved, "uv": uv})
        result = candidates(
            recording, label(recording, LabelSettings()), PairSettings(), RecordSettings(), motion=MotionSettings()
        )
        assert result.left_out.get("along", 0) + result.left_out.get("beyond_car", 0) == left_out
        assert ("tv", "HARD_BRAKE") not in {(c.tv, c.intention.name) for c in result.samples} or not left_out


def test_a_shift_along_the_road_is_no_jump_of_the_label_s_motion() -> None:
    """Labels are about the speed and the place across the road, and SUMO's shifts along it are in neither."""
    recording = driven(bent(120.0, 300.0, 60.0), ("road",), steady(20.0), lane_change(9.0))
    motion = road_motion(recording, recording.tracks["tv"], LaneGraph(recording.lanes), 0.15)
    assert not motion.jumps
    assert np.abs(motion.a).max() < 1e-6
    assert [crossing.left for crossing in motion.crossings] == [True]


def test_lanes_of_this_page_are_as_sumo_has_them() -> None:
    """All lanes of an edge have one length, and shapes that end beside each other."""
    first, second = bent(120.0, 300.0, 60.0)
    assert first.length_m == second.length_m
    for one, other in pairwise([first, second]):
        assert np.hypot(*(one.shape[-1] - other.shape[-1])) == pytest.approx(WIDTH_M)
