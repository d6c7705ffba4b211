"""Which of two tracks is of the other's vehicle, what a length that is known anew is worth, and who is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.isacsim.scene.episode import SceneSensing
from isac_cosim.isacsim.scene.extent import CAR_M, CAR_SD_M, ends_put_right
from isac_cosim.isacsim.scene.lifetime import END_STEPS, TWIN_STEPS, Birth, Tracks, without_doubles
from isac_cosim.isacsim.scene.tracker import SceneTracker
from isac_cosim.isacsim.scene.vehicles import instants
from tests.support.scene_road import LANES, SITES, recording, setup

AHEAD = np.array([1.0, 0.0])


def tracks(*states: tuple[float, float, float, float], hits: int = 10) -> Tracks:
    """Tracks that drive along +x, the oldest first: front bumper x, y (m), speed (m/s) and length (m) of each."""
    births = [
        Birth(np.array([x, y, speed, 0.0, 0.0, 0.0, length]), np.eye(7) * 0.01, AHEAD, 100.0, np.array([x, y]))
        for x, y, speed, length in states
    ]
    born = Tracks.none().with_born(births, 0)
    count = len(born)
    older = np.array([1000] + [hits] * (count - 1))
    return replace(born, hits=older, confirmed=np.ones(count, dtype=bool))


def after(of: Tracks, steps: int) -> Tracks:
    for _ in range(steps):
        of = without_doubles(of, bodies=True)
    return of


@pytest.mark.parametrize(("across_m", "left"), [(2.0, 1), (2.6, 1), (3.2, 2), (-2.6, 1), (-3.2, 2)])
def test_nobody_begins_as_close_beside_a_truck(across_m: float, left: int) -> None:
    pair = tracks((100.0, 0.0, 25.0, 14.0), (97.0, across_m, 27.0, 4.6))
    assert len(after(pair, TWIN_STEPS + 2)) == left


def test_who_has_long_been_there_may_be_as_close() -> None:
    assert len(after(tracks((100.0, 0.0, 25.0, 14.0), (97.0, 2.6, 27.0, 4.6), hits=500), TWIN_STEPS + 2)) == 2


@pytest.mark.parametrize(("answered", "left"), [((0.2, 0.9), 1), ((0.8, 0.9), 0), ((0.9, 0.2), 0)])
def test_who_has_lost_his_vehicle_does_not_end_the_track_of_another(answered: tuple[float, float], left: int) -> None:
    """Of two tracks in one place, few panels still find what the older one, number 0, expects."""
    pair = replace(tracks((100.0, 0.0, 25.0, 4.6), (100.5, 0.2, 20.0, 4.6)), answered=np.array(answered))
    assert after(pair, TWIN_STEPS + 2).number.tolist() == [left]


@pytest.mark.parametrize(
    ("speed_mps", "apart_m", "left"),
    # The ends of a slow truck; cars that follow at a second and 2 m; the ends of a long truck at full speed.
    [(15.0, 10.2, 1), (15.0, 21.6, 2), (5.0, 11.6, 2), (1.0, 7.6, 2), (25.0, 13.0, 1)],
)
def test_ends_of_one_body_are_nearer_than_people_follow(speed_mps: float, apart_m: float, left: int) -> None:
    pair = tracks((100.0, 0.0, speed_mps, CAR_M), (100.0 - apart_m, 0.1, speed_mps + 0.1, CAR_M))
    ended = after(pair, END_STEPS + 2)
    assert len(ended) == left
    if left == 1:
        assert ended.state[0, 6] == pytest.approx(apart_m + CAR_M)


def test_two_ends_that_are_a_cars_make_no_longer_car() -> None:
    pair = tracks((100.0, 0.0, 25.0, 3.2), (97.0, 0.0, 25.0, 3.0), hits=100)
    assert after(pair, END_STEPS + 2).state[:, 6].tolist() == [3.2]


@pytest.mark.parametrize(("length_m", "off_m"), [(4.5, (-2.3, 0.0)), (4.6, (0.0, -2.1)), (6.6, (0.0, 2.2))])
def test_a_car_whose_ends_are_put_right_has_the_length_of_a_car(length_m: float, off_m: tuple[float, float]) -> None:
    state, covariance = np.array([[100.0, 0.0, 25.0, 0.0, 0.0, 0.0, length_m]]), np.eye(7)[None] * 0.01
    off = np.array([off_m])
    ends_put_right(state, covariance, AHEAD[None], off)
    assert abs(state[0, 6] - CAR_M) < CAR_SD_M
    assert 0.5 * CAR_SD_M < np.sqrt(covariance[0, 6, 6]) < CAR_SD_M
    assert not off.any()


def test_a_truck_whose_ends_are_put_right_may_have_any_length() -> None:
    state, covariance = np.array([[100.0, 0.0, 25.0, 0.0, 0.0, 0.0, 9.0]]), np.eye(7)[None] * 0.01
    ends_put_right(state, covariance, AHEAD[None], np.array([[2.0, -3.0]]))
    assert state[0, 6] == pytest.approx(14.0)
    assert covariance[0, 6, 6] == 1.0


def test_the_error_that_outlasts_is_along_a_body() -> None:
    turned = replace(tracks((0.0, 0.0, 25.0, 4.6), (50.0, 0.0, 25.0, 0.0)), ahead=np.array([[0.6, 0.8], [1.0, 0.0]]))
    body, point = turned.outlasting()
    assert np.linalg.eigvalsh(body) == pytest.approx([0.0, 0.01])
    assert body @ [0.6, 0.8] == pytest.approx([0.006, 0.008])
    assert not point.any()


def test_what_one_panel_in_many_finds_is_no_body() -> None:
    scene = setup(bodies="bodies")
    panels = Panels.of(SITES, scene.target_height_m)
    sensing, tracker = SceneSensing(scene, SITES, LANES, "road", 1), SceneTracker(scene, panels, LANES)
    nothing = Detections(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    for fix, present in instants(recording({"a": (300.0, 25.0, 1)}, 4.0), scene.scene.fixes_hz, scene.motion):
        detections, _, view = sensing.sensed(fix, present)
        looking = np.flatnonzero(view[0])
        assert len(looking) > 3
        if fix >= 50:
            detections = [of if panel == looking[0] else nothing for panel, of in enumerate(detections)]
        found = tracker.step(detections)
        if fix == 49:
            assert found.confirmed.tolist() == [True]
    assert not found.confirmed.any()
