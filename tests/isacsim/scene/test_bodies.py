"""Vehicles with a body: five points, what they hide and stand before, and tracks that know where the ends are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.cross_section import points_dbsm
from isac_cosim.isacsim.scene.bodies import look
from isac_cosim.isacsim.scene.episode import SceneSensing, follow
from isac_cosim.isacsim.scene.vehicles import EchoSource, Present, instants
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from tests.support.scene_road import LANES, SITES, recording, setup

TABLE = {
    "front": (0.0, 40.54, 71.75, 29.13, 14.99, 14.91),
    "back": (180.0, 36.32, 79.65, 36.73, 13.90, 13.82),
    "left": (90.0, 26.90, 79.70, 44.42, 20.60, 20.52),
    "right": (270.0, 26.90, 79.70, 44.42, 20.60, 20.52),
    "roof": (0.0, np.inf, 0.0, 18.13, 21.12, 21.05),
}
"""Table 7.9.2.1-5 of TR 38.901: centre and width in azimuth and zenith, degrees, peak, dBsm, and depth, dB."""
FEW = {"a": (120.0, 28.0, 0), "b": (180.0, 33.0, 1), "c": (300.0, 30.0, 2)}


def trucks(of: Recording, name: str, length_m: float = 14.0) -> Recording:
    """The recording with one vehicle a truck."""
    track = replace(of.tracks[name], kind="truck", length_m=length_m, width_m=2.5)
    return replace(of, tracks={**of.tracks, name: track})


def by_the_clause(point: str, azimuth: float, zenith: float) -> float:
    """Equation 7.9.2-3 for one echo that comes back where it was sent from, written out."""
    centre, width, zenith_centre, zenith_width, peak, depth = TABLE[point]
    turned = min(abs(azimuth - centre - 360 * k) for k in (-1, 0, 1))
    across = -min(12 * (turned / width) ** 2, depth)
    upward = -min(12 * ((zenith - zenith_centre) / zenith_width) ** 2, depth)
    return max(peak - min(-(upward + across), depth), peak - depth)


@pytest.mark.parametrize("azimuth", [0.0, 20.0, 50.0, 90.0, 170.0, -90.0])
@pytest.mark.parametrize("zenith", [5.0, 60.0, 88.0])
def test_each_point_has_the_lobe_of_its_side(azimuth: float, zenith: float) -> None:
    strength = points_dbsm(np.full(5, np.radians(azimuth)), np.full(5, np.radians(zenith)))
    assert strength == pytest.approx([by_the_clause(point, azimuth, zenith) for point in TABLE], abs=1e-9)


def test_points_are_where_the_sides_are() -> None:
    """A panel 30 m to the left of a vehicle that drives along +x, looking across the road."""
    panels = Panels.of([replace(SITES[0], x=100.0, y=30.0, height_m=10.0, azimuth_deg=180.0)], 0.8)
    state, ahead = np.array([[105.0, 0.0, 20.0, 0.0]]), np.array([[1.0, 0.0]])
    measured = look(state, ahead, np.array([[10.0, 2.0, 3.0]]), panels).measured[0, 0]
    places = [(5.0, -30.0, 1.5), (-5.0, -30.0, 1.5), (0.0, -29.0, 1.5), (0.0, -31.0, 1.5), (0.0, -30.0, 3.0)]
    for (x, y, up), (sine, distance, radial) in zip(places, measured, strict=True):
        assert distance == pytest.approx(np.sqrt(x**2 + y**2 + (10.0 - up) ** 2))
        # A panel that faces south has -x to its right.
        assert sine == pytest.approx(-x / distance)
        assert radial == pytest.approx(20.0 * x / distance)


def test_a_truck_hides_the_car_behind_it() -> None:
    """Seen from a mast far down the road, the car is close behind the truck's box."""
    state = np.array([[200.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    state[1, 0] = 200.0 + 3.0 + 14.0
    size = np.array([[4.5, 1.8, 1.6], [14.0, 2.5, 3.0]])
    present = Present(["car", "truck"], state, np.zeros(2), size)
    panels = Panels.of(SITES, 0.8)
    hidden, clear = (
        EchoSource(setup(bodies="bodies", blockage=on), panels, "road", 1).echoes(present) for on in (True, False)
    )
    losses = []
    for panel in np.flatnonzero(clear[2].all(axis=0)):
        with_loss, without = (np.abs(of[0][panel].amplitude) for of in (hidden, clear))
        losses.append(20 * np.log10(with_loss / without))
    loss = np.array(losses)
    # Only the car loses, all of its points alike, and only toward masts ahead.
    assert loss[:, 5:] == pytest.approx(0.0)
    assert loss[:, :5] == pytest.approx(np.broadcast_to(loss[:, :1], (len(loss), 5)))
    assert loss.min() < -5.0
    assert (loss[:, 0] == 0.0).any()


def test_what_the_background_leaves_is_not_taken_for_vehicles() -> None:
    empty = Present([], np.empty((0, 6)), np.empty(0), np.empty((0, 3)))
    for residual_db in (-60.0, -40.0):
        scene = setup(bodies="bodies", background_points=40, residual_db=residual_db)
        sensing = SceneSensing(scene, SITES, LANES, "road", 1)
        found = sum(len(of) for fix in range(20) for of in sensing.sensed(fix, empty)[0])
        assert found <= 3


def test_cars_are_known_to_some_decimetres() -> None:
    scores = follow(recording(FEW, 5.0), SITES, setup(bodies="bodies")).scores
    assert (scores.missed, scores.switches, scores.idf1) == (0.0, 0, 1.0)
    assert scores.rms_m is not None
    assert 0.01 < scores.rms_m < 0.35


def test_who_drives_straight_on_hardly_seems_to_move_across() -> None:
    """Which of a car's points answers changes as it passes a mast; what moves across is what predictors go by."""
    scene = setup(bodies="bodies")
    sensing = SceneSensing(scene, SITES, LANES, "road", 1)
    known = [sensing.step(fix, present).state for fix, present in instants(recording(FEW, 6.0), 25.0, scene.motion)]
    velocity, acceleration = np.concatenate(known[25:])[:, [3, 5]].T
    assert np.sqrt((velocity**2).mean()) < 0.07
    assert np.sqrt((acceleration**2).mean()) < 0.2


@pytest.mark.parametrize("association", ["tracks", "truth"])
def test_the_two_ends_of_a_truck_are_one_track_of_its_length(association: str) -> None:
    driven = trucks(recording({"truck": (150.0, 24.0, 1), "car": (230.0, 30.0, 0)}, 6.0), "truck")
    scene = setup(bodies="bodies", association=association)
    sensing = SceneSensing(scene, SITES, LANES, "road", 1)
    for fix, present in instants(driven, scene.scene.fixes_hz, scene.motion):
        last = sensing.step(fix, present)
    assert sorted(name for name in last.vehicle if name) == ["car", "truck"]
    scores = sensing.tracks.scores
    assert (scores.missed, scores.switches) == (0.0, 0)
    assert scores.false is not None
    assert scores.false < 0.1
    front = last.state[last.vehicle.index("truck"), 0]
    assert front == pytest.approx(150.0 + 24.0 * fix / 25, abs=0.5)


def test_a_vehicle_that_stands_is_held_where_nothing_finds_it() -> None:
    """It is lost for three seconds, far longer than one that drives."""
    scene = setup(bodies="bodies")
    sensing = SceneSensing(scene, SITES, LANES, "road", 1)
    nobody = Present([], np.empty((0, 6)), np.empty(0), np.empty((0, 3)))
    for fix, present in instants(recording({"queue": (300.0, 0.2, 1)}, 5.0), 25.0, scene.motion):
        before = sensing.step(fix, present)
    for later in range(1, 76):
        after = sensing.step(fix + later, nobody)
    assert before.number.tolist() == after.number.tolist()
    assert after.state[0, :2] == pytest.approx(before.state[0, :2], abs=0.5)


def test_who_stood_unseen_is_known_again_when_it_has_pulled_off() -> None:
    """Hidden for 1.2 s, it has come 2 m farther meanwhile, and drives at 3.5 m/s."""
    scene = setup(bodies="bodies")
    sensing = SceneSensing(scene, SITES, LANES, "road", 1)
    nobody = Present([], np.empty((0, 6)), np.empty(0), np.empty((0, 3)))
    stood = recording({"first": (300.0, 0.2, 1)}, 3.0)
    x, t = stood.tracks["first"].x, stood.times(stood.tracks["first"])
    pulled_off = np.maximum(t - 1.5, 0.0)
    driven = replace(stood.tracks["first"], x=x + 1.5 * pulled_off**2, speed=0.2 + 3.0 * pulled_off)
    seen_from = []
    for fix, present in instants(replace(stood, tracks={"first": driven}), 25.0, scene.motion):
        hidden = 37 <= fix < 67
        known = sensing.step(fix, nobody if hidden else present)
        if not hidden and fix > 10:
            seen_from.append(known.number.tolist())
    assert seen_from[-1] == seen_from[0] != []
    assert known.state[0, 2] == pytest.approx(4.7, abs=0.5)


@pytest.mark.slow
def test_who_has_driven_off_the_end_of_the_road_is_not_followed() -> None:
    """On the road, a track is predicted for a second where nothing finds it any more."""
    ends = LANES[0].shape[-1, 0]
    scene = setup(bodies="bodies")
    nobody = Present([], np.empty((0, 6)), np.empty(0), np.empty((0, 3)))
    left = {}
    for start in (ends - 31.0 * 3.0, 300.0):
        sensing = SceneSensing(scene, SITES, LANES, "road", 1)
        for fix, present in instants(recording({"a": (start, 30.0, 1)}, 3.0), 25.0, scene.motion):
            assert len(sensing.step(fix, present).number) == (fix >= 5)
        left[start] = [len(sensing.step(fix + k, nobody).number) for k in range(1, 40)]
    at_the_end, on_the_way = left.values()
    assert sum(at_the_end) <= 6
    assert 25 <= sum(on_the_way) < 39
