"""Left and right in traffic that keeps left: labels, commands and sides compared with positions in the plane.

SUMO simulates a network for left-hand traffic as the mirror image of one for right-hand traffic, and calls right left.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import LANE_CHANGES, Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings
from tests.support.roads import straight_road

LEFT, RIGHT = LANE_CHANGES
QUIET = ManeuverSettings(**{name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")})
TRAFFIC = TrafficSettings(run_in_s=2.0, duration_s=70.0)
MIRRORED = {LEFT: RIGHT, RIGHT: LEFT}


def recorded(folder: Path, lefthand: bool, **rates: float) -> Recording:
    """Record fast cars behind slow ones on three lanes under commands, which the sites along the road all reach."""
    side = 1 if lefthand else -1
    sites = "".join(
        f'<poi id="s{k}" x="{300 * k}" y="{25 * side}" type="isac_site"><param key="height" value="15"/>'
        '<param key="azimuth" value="180"/></poi>'
        for k in range(11)
    )
    slow = (
        '<vType id="slow" carFollowModel="IDM" maxSpeed="21" speedDev="0" latAlignment="center" lcSpeedGain="0" '
        'lcKeepRight="0"/>'
    )
    cars = "".join(
        f'<vehicle id="v{k}" type="{"car" if k % 2 else "slow"}" route="all" depart="{1.6 * k}" '
        f'departLane="{(k // 2) % 2}" departPos="5" departSpeed="{24 if k % 2 else 20}"/>'
        for k in range(24)
    )
    settings = QUIET.model_copy(update={f"{name}_per_vehicle_hour": rate for name, rate in rates.items()})
    settings = settings.model_copy(update={"rest_s": 2.0})
    road = straight_road(folder / "road", slow + cars, sites, lefthand=lefthand)
    return record(load(road), 5, TRAFFIC, settings)


def moved_left_m(recording: Recording, track: Track, event: Event) -> float:
    """Return how far a vehicle moves left of its lane's heading, in the plane, from onset to the motion's end, m."""
    rows = [round(time / recording.step_s) - track.first_step for time in (event.onset, event.busy_until)]
    moved = np.diff([track.x[rows], track.y[rows]], axis=1)[:, 0]
    along = np.diff(recording.lanes[track.lane[rows[0]]].shape[:2], axis=0)[0]
    return float((along[0] * moved[1] - along[1] * moved[0]) / np.hypot(*along))


def lane_changes(labels: Labels) -> list[tuple[str, Event]]:
    return [(vehicle, change) for vehicle, changes in labels.changes.items() for change in changes]


@pytest.mark.parametrize("lefthand", [False, True])
@pytest.mark.parametrize("command", ["left_change", "right_change"])
def test_a_commanded_and_labelled_side_is_that_side_in_the_plane(tmp_path: Path, lefthand: bool, command: str) -> None:
    recording = recorded(tmp_path, lefthand, **{command: 300.0})
    assert recording.lefthand is lefthand
    labels = label(recording, LabelSettings())
    commanded = 0
    for vehicle, change in lane_changes(labels):
        moved_m = moved_left_m(recording, recording.tracks[vehicle], change)
        assert abs(moved_m) > 1.0
        assert (change.intention is LEFT) == (moved_m > 0)
        if any(c.start <= change.onset < c.end - 3.0 for c in recording.commands_to.get(vehicle, [])):
            assert (change.intention is LEFT) == (command == "left_change")
            commanded += 1
    assert commanded > 5


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Recording]:
    """The same traffic and commands where traffic keeps right and where it keeps left."""
    rates = {"overtake": 400.0, "swerve": 200.0, "hard_brake": 50.0, "cut_in": 100.0}
    keeps_right, keeps_left = (
        recorded(tmp_path_factory.mktemp("mirror"), lefthand, **rates) for lefthand in (False, True)
    )
    return keeps_right, keeps_left


def test_traffic_that_keeps_left_is_the_mirror_image_of_traffic_that_keeps_right(
    both: tuple[Recording, Recording],
) -> None:
    keeps_right, keeps_left = both
    assert keeps_right.commands == keeps_left.commands != ()
    for name, track in keeps_right.tracks.items():
        mirror = keeps_left.tracks[name]
        for column, sign in {"x": 1, "y": -1, "speed": 1, "lane": 1, "lane_pos": 1, "lane_lat": -1}.items():
            np.testing.assert_allclose(getattr(mirror, column), sign * getattr(track, column), rtol=0, atol=1e-3)


@pytest.mark.parametrize("lefthand", [False, True])
def test_lateral_positions_are_positive_to_the_left_in_the_plane(
    both: tuple[Recording, Recording], lefthand: bool
) -> None:
    recording = both[lefthand]
    for track in recording.tracks.values():
        centre = np.array([lane.shape[0, 1] for lane in recording.lanes])[track.lane]
        np.testing.assert_allclose(track.lane_lat, track.y - centre, rtol=0, atol=1e-3)
    assert max(np.abs(track.lane_lat).max() for track in recording.tracks.values()) > 1.0


def test_labels_are_mirrored_and_an_overtake_stays_an_overtake(both: tuple[Recording, Recording]) -> None:
    events, mirrored = ([e for e in label(r, LabelSettings()).events if e.mark is None] for r in both)
    assert {event.intention for event in events} >= {*LANE_CHANGES, Intention.OVERTAKE, Intention.EVASIVE_SWERVE}
    lateral = {*LANE_CHANGES, Intention.OVERTAKE, Intention.EVASIVE_SWERVE}
    by_onset = {(event.vehicle, event.intention, round(event.onset, 6)): event for event in mirrored}
    assert len(by_onset) == len(mirrored) == len(events)
    for event in events:
        image = by_onset[event.vehicle, MIRRORED.get(event.intention, event.intention), round(event.onset, 6)]
        sign = -1.0 if event.intention in lateral else 1.0
        assert (image.end, image.peak) == pytest.approx((event.end, sign * event.peak), abs=1e-6)


@pytest.mark.parametrize("lefthand", [False, True])
def test_an_overtake_pulls_out_to_the_faster_side_and_returns(
    both: tuple[Recording, Recording], lefthand: bool
) -> None:
    recording = both[lefthand]
    labels = label(recording, LabelSettings())
    overtakes = labels.of(Intention.OVERTAKE)
    assert overtakes
    for overtake in overtakes:
        moved_m = moved_left_m(recording, recording.tracks[overtake.vehicle], overtake)
        assert moved_m < -1.0 if lefthand else moved_m > 1.0
        back = next(c for c in labels.changes[overtake.vehicle] if c.commit == overtake.end)
        assert back.intention is (LEFT if lefthand else RIGHT)


def test_samples_of_the_mirror_image_are_mirrored(both: tuple[Recording, Recording]) -> None:
    """Also where an overtake is no overtake of the UV, and in the side on which the UV is."""
    pairs, brief = PairSettings(fall_back=True), RecordSettings(margin_s=0.2, jitter_s=0.0)
    kept_right, kept_left = (candidates(r, label(r, LabelSettings()), pairs, brief) for r in both)
    sides = {"left": "right", "right": "left"}
    assert {sample.relation for sample in kept_right.samples} & {"left", "right"}
    assert kept_right.left_out == kept_left.left_out
    assert sorted(
        (s.tv, s.uv, MIRRORED.get(s.intention, s.intention), sides.get(s.relation, s.relation), round(s.t_onset, 6))
        for s in kept_right.samples
    ) == sorted((s.tv, s.uv, s.intention, s.relation, round(s.t_onset, 6)) for s in kept_left.samples)


def test_the_side_of_another_vehicle_is_its_side_in_the_plane(both: tuple[Recording, Recording]) -> None:
    for recording in both:
        surroundings = Surroundings(recording)
        sides = set()
        for vehicle, track in recording.tracks.items():
            for other in surroundings.present(40.0):
                rows = [surroundings.step(40.0) - t.first_step for t in (track, other)]
                if 0 <= rows[0] < len(track):
                    relation = surroundings.relation(vehicle, other.vehicle, 40.0)
                    if relation in ("left", "right"):
                        sides.add(relation)
                        assert (other.y[rows[1]] > track.y[rows[0]]) == (relation == "left")
        assert sides == {"left", "right"}
