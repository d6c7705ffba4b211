"""The kinematic source: motion that a car can drive, in scenes that are what they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.sensing.chain import ViewSettings, assign
from isac_cosim.isacsim.traffic.recordings.recording import GeneratedManeuver, LabelledRecording
from isac_cosim.isacsim.traffic.sources.kinematic import SCENARIO, KinematicSource, straight_road_of
from isac_cosim.isacsim.traffic.sources.kinematic_scenes import PLANS, STEP_S, Scene, SceneDraw
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings

WIDTH_M = 3.6
SOURCE = KinematicSource(KinematicSettings(per_class=2, following_scenes=2))


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return SOURCE.load(SCENARIO)


@pytest.fixture(scope="module")
def recording(scenario: Scenario) -> LabelledRecording:
    return SOURCE.record(scenario, 1)


def drawn(intention: str, seed: int, content: KinematicSettings | None = None) -> Scene:
    """The first scene of an intention that keeps the limits."""
    rng = np.random.default_rng(seed)
    while (scene := SceneDraw(intention, content or KinematicSettings(), WIDTH_M, rng).scene()) is None:
        pass
    return scene


intentions = st.sampled_from(sorted(PLANS))
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(intentions, seeds)
def test_speeds_are_the_derivatives_of_positions_and_motion_is_a_cars(intention: str, seed: int) -> None:
    scene, limits = drawn(intention, seed), KinematicSettings().limits
    for motion in (scene.tv, scene.uv):
        np.testing.assert_allclose(
            np.diff(motion.along) / STEP_S, (motion.speed[1:] + motion.speed[:-1]) / 2, atol=1e-9
        )
        assert motion.speed.min() >= limits.least_speed_mps
        along, across = np.diff(motion.speed) / STEP_S, np.diff(motion.left, 2) / STEP_S**2
        assert np.hypot(along[1:], across).max() <= limits.acceleration_mps2 * 1.01
        assert np.hypot(np.diff(along[1:]), np.diff(across)).max() / STEP_S <= limits.jerk_mps3 * 1.05


@settings(max_examples=60, deadline=None)
@given(intentions, seeds)
def test_nobody_touches_and_only_an_overtaking_vehicle_passes(intention: str, seed: int) -> None:
    scene = drawn(intention, seed)
    tv, uv = scene.tv, scene.uv
    behind = uv.along - uv.length_m - tv.along
    ahead = tv.along - tv.length_m - uv.along
    overlapping = (np.abs(tv.left - uv.left) < 1.8) & (np.maximum(behind, ahead) < 0)
    assert not overlapping.any()
    assert behind[0] > 0
    assert (ahead[-1] > 0) == (intention == "overtake")
    assert (behind.min() < 0) == (intention == "overtake")
    assert 0 <= scene.commit <= scene.end < scene.times[-1]


@settings(max_examples=60, deadline=None)
@given(intentions, seeds)
def test_before_onset_the_vehicle_only_sways(intention: str, seed: int) -> None:
    """The onset is the first motion, but for following, which has none."""
    scene, situation = drawn(intention, seed), KinematicSettings().situation
    early = scene.times < -1e-9
    acceleration = np.diff(scene.tv.speed) / STEP_S
    if intention != "following":
        assert np.abs(acceleration[early[1:]]).max() <= situation.speed_sway_mps2[1] + 1e-9
    assert np.abs(scene.tv.left[early]).max() <= situation.lane_sway_m[1] + 1e-9


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_lateral_maneuvers_end_in_the_lane_that_they_are_named_after(seed: int) -> None:
    level = {"left_lane_change": 1, "right_lane_change": -1, "overtake": 0, "evasive_swerve": 0, "hard_brake": 0}
    for intention, lanes in level.items():
        left = drawn(intention, seed).tv.left
        assert abs(left[-1] - lanes * WIDTH_M) < 0.25
        if intention == "overtake":
            assert abs(left.max() - WIDTH_M) < 0.45
        if intention == "evasive_swerve":
            assert 0.75 < np.abs(left).max() < 2.25


def test_hard_maneuvers_reach_the_drawn_peak(recording: LabelledRecording) -> None:
    s = KinematicSettings()
    for seed in range(5):
        brake, surge = drawn("hard_brake", seed), drawn("hard_accel", seed)
        strongest = -np.diff(brake.tv.speed).min() / STEP_S
        assert s.hard_brake.peak_mps2[0] - 0.4 <= strongest <= s.hard_brake.peak_mps2[1] + 0.4
        strongest = np.diff(surge.tv.speed).max() / STEP_S
        assert s.hard_accel.peak_mps2[0] - 0.4 <= strongest <= s.hard_accel.peak_mps2[1] + 0.4


def test_causes_and_first_responses_come_as_often_as_drawn() -> None:
    content = KinematicSettings().model_dump()
    content["response"] |= {"cause_share": 0.0, "share": 0.0}
    calm = checked(KinematicSettings, content, "test")
    content["response"] |= {"cause_share": 1.0, "share": 1.0}
    tense = checked(KinematicSettings, content, "test")
    for seed in range(4):
        scene = drawn("hard_brake", seed, calm)
        assert scene.cause == ""
        assert np.abs(np.diff(scene.uv.speed)).max() / STEP_S <= calm.situation.speed_sway_mps2[1]
        early = (scene.times[1:] > 0.15) & (scene.times[1:] < 0.4)
        caused = drawn("hard_brake", seed, tense)
        assert caused.cause == "uv_brakes"
        braking = np.flatnonzero(-np.diff(caused.uv.speed) / STEP_S > 1.0)
        assert -1.6 < caused.times[braking[0]] < 0.0
        gentle = -np.diff(caused.tv.speed)[early] / STEP_S
        assert gentle.max() <= tense.response.braking_mps2[1] + tense.situation.speed_sway_mps2[1]
    assert drawn("hard_accel", 1, tense).cause == "uv_accelerates"


def test_a_recording_holds_the_scenes_one_after_the_other(recording: LabelledRecording) -> None:
    assert [m.intention for m in recording.maneuvers].count("overtake") == 2
    assert len(recording.maneuvers) == 2 * 7
    for manoeuvre, later in zip(recording.maneuvers, recording.maneuvers[1:], strict=False):
        tracks = [recording.tracks[name] for name in (manoeuvre.tv, manoeuvre.uv)]
        assert len({len(track) for track in tracks}) == 1
        following = recording.tracks[later.tv]
        assert tracks[0].first_step + len(tracks[0]) <= following.first_step
    for track in recording.tracks.values():
        lane = [recording.lanes[k] for k in track.lane]
        np.testing.assert_allclose([item.shape[0, 1] for item in lane] + track.lane_lat, track.y, atol=1e-9)
        np.testing.assert_allclose(track.x - lane[0].shape[0, 0], track.lane_pos, atol=1e-9)
        assert np.abs(track.lane_lat).max() <= WIDTH_M / 2 + 1e-9


def test_equal_seeds_give_equal_scenes_and_other_seeds_others(scenario: Scenario, recording: LabelledRecording) -> None:
    again, other = SOURCE.record(scenario, 1), SOURCE.record(scenario, 2)
    assert again.maneuvers == recording.maneuvers != other.maneuvers
    for name, track in recording.tracks.items():
        assert np.array_equal(again.tracks[name].x, track.x)
        assert not np.array_equal(other.tracks[name].x, track.x)


@settings(max_examples=5, deadline=None)
@given(st.floats(-5e3, 5e3), st.floats(-5e3, 5e3), st.floats(0.0, 2 * np.pi))
def test_a_road_elsewhere_carries_the_same_motion(x: float, y: float, angle: float) -> None:
    """The road shifted and turned: the same scenes, shifted and turned."""
    scenario = load(SCENARIO)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def moved(points: np.ndarray) -> np.ndarray:
        return points @ turn.T + (x, y)

    lanes = tuple(replace(lane, shape=moved(lane.shape)) for lane in scenario.lanes)
    sites = tuple(
        replace(site, **dict(zip("xy", moved(np.array([site.x, site.y])), strict=True))) for site in scenario.sites
    )
    source = KinematicSource(KinematicSettings(per_class=1, following_scenes=0))
    here, there = source.record(scenario, 3), source.record(replace(scenario, lanes=lanes, sites=sites), 3)
    assert [m.intention for m in here.maneuvers] == [m.intention for m in there.maneuvers]
    for name, track in here.tracks.items():
        points = np.stack([there.tracks[name].x, there.tracks[name].y], axis=1)
        np.testing.assert_allclose(points, moved(np.stack([track.x, track.y], axis=1)), atol=1e-6)


def test_all_four_sites_see_every_record(recording: LabelledRecording) -> None:
    panels = Panels.of(load(SCENARIO).sites, 0.8)

    def positions(m: GeneratedManeuver) -> np.ndarray:
        track = recording.tracks[m.tv]
        first = round((m.onset - 2.8) / STEP_S) - track.first_step
        return np.stack([track.x, track.y], axis=1)[first : first + 560]

    for maneuver in recording.maneuvers:
        assert (assign(positions(maneuver), 100.0, panels, ViewSettings()) >= 0).all()


def test_a_scenario_without_a_straight_road_is_refused(scenario: Scenario) -> None:
    with pytest.raises(InputError, match="use the bundled scenario straight_road"):
        SOURCE.load("urban")
    with pytest.raises(InputError, match="keeps right"):
        straight_road_of(replace(scenario, lefthand=True))
    narrow = tuple(lane for lane in scenario.lanes if lane.index < 3)
    with pytest.raises(InputError, match="at least 4 lanes"):
        straight_road_of(replace(scenario, lanes=narrow))


def test_ranges_that_leave_no_scene_are_reported(scenario: Scenario) -> None:
    impossible = {"situation": {"gap_m": [1.0, 1.0]}, "limits": {"draws": 3}, "per_class": 1}
    source = KinematicSource(checked(KinematicSettings, impossible, "test"))
    with pytest.raises(InputError, match="none of 3 drawn scenes of hard_brake keeps the limits"):
        source.record(scenario, 1)


@pytest.mark.parametrize("wrong", [[3.0, 1.0], [-1.0, 3.0], [1.0, 30.0], 2.0, [1.0]])
def test_wrong_ranges_are_refused(wrong: object) -> None:
    with pytest.raises(InputError, match=r"hard_brake\.peak_mps2: .*must be a range \[low, high\]"):
        checked(KinematicSettings, {"hard_brake": {"peak_mps2": wrong}}, "test")
