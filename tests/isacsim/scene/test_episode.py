"""Whole episodes: everybody is found and kept, near neighbours, standing and very fast vehicles included."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scene import episode
from isac_cosim.isacsim.scene.detection import Detections, detect
from isac_cosim.isacsim.scene.episode import SceneSensing, detections_kept, follow
from isac_cosim.isacsim.scene.tracks import SceneTracks
from isac_cosim.isacsim.scene.vehicles import instants
from tests.support.scene_road import LANES, SITES, recording, setup

FEW = {"a": (120.0, 28.0, 0), "b": (180.0, 33.0, 1), "c": (300.0, 30.0, 2)}


def owners(tracks: SceneTracks, vehicle: str) -> set[int]:
    """Numbers of the tracks that were a vehicle's."""
    return {
        int(number)
        for of in tracks.instants.values()
        for number, name in zip(of.number, of.vehicle, strict=True)
        if name == vehicle
    }


@pytest.mark.parametrize("association", ["tracks", "truth"])
def test_vehicles_apart_are_known_to_the_centimetre(association: str) -> None:
    tracks = follow(recording(FEW, 5.0), SITES, setup(association=association))
    scores = tracks.scores
    assert (scores.missed, scores.false, scores.switches, scores.idf1) == (0.0, 0.0, 0, 1.0)
    assert scores.rms_m is not None
    assert scores.rms_m < 0.01
    assert all(len(owners(tracks, name)) == 1 for name in FEW)
    assert len(tracks.instants) == 125


def test_a_vehicle_is_overtaken_a_lane_away_without_a_mistake() -> None:
    """They share cells for a moment: one detection for two, and the tracks have to outlast it."""
    tracks = follow(recording({"slow": (300.0, 25.0, 0), "fast": (280.0, 35.0, 1)}, 5.0), SITES, setup())
    assert (tracks.scores.switches, tracks.scores.false, tracks.scores.missed) == (0, 0.0, 0.0)


def test_a_vehicle_that_stands_is_known() -> None:
    tracks = follow(recording({"queue": (300.0, 0.0, 1), "past": (200.0, 30.0, 0)}, 4.0), SITES, setup())
    assert tracks.scores.missed_slow == 0.0
    assert tracks.scores.false == 0.0


QUEUE = {f"{lane}-{k}": (400.0 - 7.0 * k - 2.0 * lane, 0.0, lane) for lane in (0, 1) for k in range(4)}


@pytest.mark.parametrize("association", ["tracks", "truth"])
def test_a_queue_of_bodies_that_was_followed_before_is_known_from_the_first_instant(association: str) -> None:
    scene = {"bodies": "bodies", "association": association}
    cars = {**QUEUE, "past": (300.0, 25.0, 2)}
    known = follow(recording(cars, 2.0), SITES, setup(**scene, begin="followed"), settled_s=0.0)
    assert (known.scores.missed, known.scores.missed_slow, known.scores.switches) == (0.0, 0.0, 0)
    assert {name for name in known.instants[0].vehicle if name} == set(cars)
    found = follow(recording(cars, 2.0), SITES, setup(**scene), settled_s=0.0)
    assert found.scores.missed_slow is not None
    assert found.scores.missed_slow > 0.1
    # The errors that tracks begin with are drawn, the same for everybody who asks.
    again = follow(recording(cars, 0.2), SITES, setup(**scene, begin="followed"))
    assert np.array_equal(again.instants[0].state, known.instants[0].state)


def test_radial_velocities_beyond_the_ambiguity_are_resolved_by_the_track() -> None:
    """At 50 m/s the numerology sees 42.8 m/s at most: along the road, the radial velocity comes out reversed."""
    scene = setup()
    waveform = scene.numerology.waveform
    assert waveform.symbols / np.abs(waveform.cells_per_unit[2]) / 2 == pytest.approx(42.8, abs=0.1)
    tracks = follow(recording({"fast": (100.0, 50.0, 1)}, 5.0), SITES, scene)
    assert (tracks.scores.missed, tracks.scores.switches) == (0.0, 0)
    last = max(tracks.instants)
    assert tracks.instants[last].state[0, 2] == pytest.approx(50.0, abs=0.1)


def test_equal_episodes_are_equal_and_others_have_draws_of_their_own() -> None:
    driven = recording(FEW, 1.0)
    one, same = (follow(driven, SITES, setup()) for _ in range(2))
    other = follow(replace(driven, seed=2), SITES, setup())
    last = max(one.instants)
    assert np.array_equal(one.instants[last].state, same.instants[last].state)
    assert not np.array_equal(one.instants[last].state, other.instants[last].state)


def test_an_episode_is_the_same_instant_by_instant() -> None:
    """What runs in a world that runs is what senses a recording."""
    driven = recording(FEW, 2.0, first_s=90.0)
    whole, scene = follow(driven, SITES, setup()), setup()
    sensing = SceneSensing(scene, SITES, LANES, "road", 1)
    for fix, present in instants(driven, scene.scene.fixes_hz, scene.motion):
        assert 90.0 <= fix / 25 <= 92.0
        now = sensing.step(fix, present)
        assert np.array_equal(now.state, whole.instants[fix].state)
        assert now.vehicle == whole.instants[fix].vehicle
    assert sensing.tracks.scores == whole.scores


def test_an_episode_whose_detections_are_kept_is_sensed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cars = recording(FEW, 1.0)
    alone = [follow(cars, SITES, setup(association=of)) for of in ("truth", "tracks")]
    calls: list[int] = []

    def counted(*given: Any) -> Detections:
        calls.append(1)
        return detect(*given)

    monkeypatch.setattr(episode, "detect", counted)
    with detections_kept():
        for association, expected in zip(("truth", "tracks"), alone, strict=True):
            same = follow(cars, SITES, setup(association=association))
            for fix, of in expected.instants.items():
                assert np.array_equal(same.instants[fix].state, of.state)
        once = len(calls)
        assert once == len(SITES) * len(alone[0].instants)
        follow(cars, SITES, setup(bodies="bodies"))
        assert len(calls) == 2 * once
        follow(recording({**FEW, "a": (121.0, 28.0, 0)}, 1.0), SITES, setup())  # other traffic of the same seed
        assert len(calls) == 3 * once
    follow(cars, SITES, setup())
    assert len(calls) == 4 * once


def test_the_paper_numerology_mixes_up_who_is_near() -> None:
    """In cells of 39 m and 14 degrees, three vehicles within 60 m are seldom three detections."""
    near = {"a": (300.0, 30.0, 0), "b": (315.0, 30.0, 1), "c": (330.0, 30.0, 2)}
    wide, narrow = (follow(recording(near, 4.0), SITES, setup(numerology=name)) for name in ("nr100", "paper"))
    assert wide.scores.gospa_m is not None
    assert narrow.scores.gospa_m is not None
    assert wide.scores.gospa_m < 0.1 < narrow.scores.gospa_m


def test_power_and_rain_change_the_snr_of_tracks() -> None:
    driven = recording({"a": (300.0, 30.0, 0)}, 1.0)

    def snr_db(**scene: object) -> float:
        of = follow(driven, SITES, setup(**scene)).followed("a", np.array([0.9]))
        assert of is not None
        return of.snr_db

    assert snr_db() - snr_db(power_dbm=36.0) == pytest.approx(10.0, abs=0.2)


def test_without_sites_nothing_is_sensed() -> None:
    with pytest.raises(InputError, match="no sites"):
        follow(recording(FEW, 1.0), (), setup())
