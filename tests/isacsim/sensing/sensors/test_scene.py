"""The scene as a sensor: of records, and of a world that runs, with equal results."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.passages import Passage, Piece, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import SCENE, SENSORS, Watch, watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from tests.support.scene_road import SITES, recording

RATE_HZ = 400.0
DRIVEN = recording({"tv": (120.0, 28.0, 0), "uv": (180.0, 33.0, 1), "late": (0.0, 30.0, 2)}, 4.0)
SETTINGS = SensorSettings.model_validate({"sensing": {"scene": {"bodies": "points"}}})


def watched(driven: Recording | None = DRIVEN) -> Watch:
    return watch(SCENE, WatchedTraffic("road", 1, SITES, RATE_HZ, recording=driven), SETTINGS)


def true_states(vehicle: str, times: np.ndarray) -> np.ndarray:
    return motion.states(DRIVEN, DRIVEN.tracks[vehicle], times, motion.MotionSettings())


def passage(vehicle: str, start_s: float, count: int) -> Passage:
    times = start_s + np.arange(count) / RATE_HZ
    return Passage(vehicle, start_s, true_states(vehicle, times), ("key",))


def pieces(length: int) -> Iterator[Piece]:
    """The recording as a running world gives it, from its beginning on."""
    for end in range(length, round(3.9 * RATE_HZ), length):
        times = np.arange(end - length + 1, end + 1) / RATE_HZ
        states = np.stack([true_states(name, times) for name in DRIVEN.tracks])
        yield Piece(end / RATE_HZ, tuple(DRIVEN.tracks), states, states[:, :, ::4], DRIVEN)


def test_a_record_is_its_track_with_what_is_said_of_it() -> None:
    sensor = watched()
    (record,) = sensor.record([passage("tv", 1.5, 800)])
    assert record.usable
    assert np.hypot(*(record.state[:2] - passage("tv", 1.5, 800).truth[:2])).max() < 0.05
    assert record.track is not None
    assert (record.track.right_share, record.track.breaks) == (1.0, 0)
    assert 0 < record.track.position_sd_m < 0.1
    assert record.n_sites >= 2
    assert record.snr_db > 0
    assert sensor.scene_scores is not None
    assert sensor.scene_scores.idf1 is not None


def test_a_tv_without_a_track_is_left_out() -> None:
    """Nobody has a track in the first instants."""
    first, later = watched().record([passage("tv", 0.05, 100), passage("tv", 1.0, 100)])
    assert (first.usable, first.track, later.usable) == (False, None, True)
    view = watched().picture.in_view(passage("tv", 0.05, 400))
    assert not view[:40].any()
    assert view[200:].all()


def test_a_running_world_gives_what_its_recording_gives() -> None:
    (record,) = watched().record([passage("tv", 1.0, 1000)])
    running, states, times = watched(None), [], []
    for piece in pieces(40):
        sensed = running.step(piece, {"tv": "uv"})
        states.append(sensed.state[0] if sensed.names else np.full((6, 40), np.nan))
        times.append(piece.end_s + (np.arange(40) - 39) / RATE_HZ)
    at = np.concatenate(times)
    known = (at > 1.0 - 1e-6) & (at < 3.5 - 1e-6)
    # A running world has no instant at time 0, so that its filters begin one instant later.
    assert np.concatenate(states, axis=1)[:, known] == pytest.approx(record.state, abs=0.02)


def test_other_sensors_have_no_scores_of_a_scene() -> None:
    traffic = WatchedTraffic("road", 1, SITES, RATE_HZ)
    assert watch("truth", traffic, SETTINGS).scene_scores is None
    assert watched(None).scene_scores is not None


def test_a_scene_has_the_link_budget() -> None:
    assert SensingSettings.model_validate({"scene": {}}).channel.kind == "link"
    assert "scene" not in SensingSettings().model_dump()
    stored = SensingSettings.model_validate({"scene": {"numerology": "paper"}}).model_dump(mode="json")
    assert SensingSettings.model_validate(stored).model_dump(mode="json") == stored
    for content, fault in (
        ({"scene": {}, "channel": {"kind": "uniform"}}, "make it .link."),
        ({"scene": {}, "channel": {"kind": "link", "blockage": True}}, "no blockage"),
        ({"scene": {"numerology": "fr2"}}, "scene.numerology"),
        ({"scene": {"fixes_hz": 0.0}}, "scene.fixes_hz"),
        ({"scene": {"bodies": True}}, "bodies"),
    ):
        with pytest.raises(InputError, match=fault):
            checked(SensingSettings, content, "study")


def test_without_sites_the_scenario_is_at_fault() -> None:
    with pytest.raises(InputError, match="no sites"):
        SENSORS[SCENE].watch(WatchedTraffic("road", 1, (), RATE_HZ), SETTINGS)  # type: ignore[union-attr]
