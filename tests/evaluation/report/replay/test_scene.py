"""The replay of a scene: the network's tracks and detections near each record, as they were when it was sensed."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.evaluation.report.replay.content import Detected, Moving, Replay, TrackPath
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.evaluation.report.replay.scene import scene_views
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation import recorded_again
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.recorded_again import Recorder
from tests.support.scene_road import SITES
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

SCENE = {"scene": {"bodies": "points", "fixes_hz": 5.0}, "channel": {"kind": "link"}}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    return ScriptedSource(tmp_path_factory.mktemp("road"))


@pytest.fixture(scope="module")
def dataset(source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    study = small_study(seeds={"first": 1, "last": 1}, sensing=SCENE)
    return generate(study, tmp_path_factory.mktemp("scene") / "data", InlineEngine(), source=source)


@pytest.fixture(scope="module")
def shown(source: ScriptedSource, dataset: Dataset) -> Replay:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_again, "motion_source", lambda study: source)
        recorded_again._load.cache_clear()
        return replay_of(dataset, dataset.meta.shards[0], InlineEngine())


def along(path: TrackPath, record: Moving) -> np.ndarray[Any, Any]:
    """How far a track is from the TV's true path at each of its times, m."""
    times = path.from_s + path.step_s * np.arange(path.places.shape[1])
    true = np.stack([np.interp(times, np.arange(record.truth.shape[1]) / 25.0, axis) for axis in record.truth])
    return np.hypot(*(path.places - true))


@pytest.mark.slow
def test_the_track_of_the_tv_lies_on_it_and_knows_how_well(shown: Replay, dataset: Dataset) -> None:
    assert "A scene: an ellipse" in shown.remarks[0]
    samples = dataset.samples(dataset.meta.shards[0])
    for record, sample in zip(shown.records, samples, strict=True):
        (own,) = (track for track in record.tracks if track.number == sample.track_id)
        assert own.places.shape[1] >= 20
        assert along(own, record).max() < 0.5
        xx, xy, yy = own.spread
        assert (xx * yy - xy**2 > 0).all()
        assert np.median(np.sqrt(xx + yy)) == pytest.approx(sample.position_sd_m, rel=0.3)


@pytest.mark.slow
def test_detections_of_every_instant_lie_near_vehicles(shown: Replay, dataset: Dataset) -> None:
    samples, rate_hz = dataset.samples(dataset.meta.shards[0]), dataset.meta.tv_rate_hz
    for record, sample in zip(shown.records, samples, strict=True):
        assert record.detected is not None
        last_s = (sample.tv_truth.shape[1] - 1) / rate_hz
        assert len(record.detected.places) == len(np.arange(record.detected.from_s, last_s + 1e-6, 0.2))
        for k, places in enumerate(record.detected.places):
            row = min(round((record.detected.from_s + 0.2 * k) * 25), record.truth.shape[1] - 1)
            assert np.hypot(*(places - record.truth[:, row]).T).min() < 1.5


@pytest.mark.slow
def test_tracks_that_are_not_those_of_the_records_are_not_shown(source: ScriptedSource, dataset: Dataset) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_again, "motion_source", lambda study: source)
        recorded_again._load.cache_clear()
        recorder, samples = Recorder.of(dataset), dataset.samples(dataset.meta.shards[0])
        recording, scenario = recorder.record("road", 1, samples), recorder.scenario("road")
    changed = [replace(samples[0], tv=samples[0].tv + np.float32(1e-3)), *samples[1:]]
    assert scene_views(recorder.study, scenario, recording, changed) is None


def test_a_detection_lies_where_the_panel_measured_it() -> None:
    panels, place = Panels.of(SITES, 0.5), np.array([180.0, 6.0])
    for panel, site in enumerate(SITES):
        apart = place - [site.x, site.y]
        distance = np.sqrt(apart @ apart + (site.height_m - 0.5) ** 2)
        if apart @ panels.front[panel] <= 0:
            continue
        measured = np.array([[apart @ panels.right[panel] / distance, distance, 3.0], [0.0, 1.0, 0.0]])
        found = Detections(measured, np.ones((2, 3)), np.ones(2)).places(panels, panel)
        assert found[0] == pytest.approx(place)
        assert np.isnan(found[1]).all()  # Nearer than the mast is high.


def test_packed_tracks_and_detections_are_those_of_the_record(tmp_path: Path) -> None:
    path = np.array([[0.0, 10.0], [0.0, 1.0]])
    spread = np.array([[0.04, 0.05], [0.01, -0.01], [0.02, 0.03]])
    found = [np.array([[1.0, 2.0], [np.nan, 0.0]]), np.empty((0, 2)), np.array([[3.0, 4.0]])]
    record = Moving(
        "a", "overtake", "natural", "t", "u", 0.0, [], path, path, path,
        tracks=[TrackPath("7", 0.2, 0.2, path, spread)], detected=Detected(0.0, 0.2, found),
    )  # fmt: skip
    content = record.packed()
    (track,), detected = content["scene"]["tracks"], content["scene"]["detected"]

    def numbers(text: str, width: int) -> np.ndarray[Any, Any]:
        return np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, width)

    middle, step = np.array(content["middle"]), content["step"]
    assert middle + step * numbers(track["places"], 2) == pytest.approx(path.T, abs=step)
    assert track["finest"] * numbers(track["spread"], 3) == pytest.approx(spread.T, abs=track["finest"])
    assert detected["counts"] == [1, 0, 1]
    assert middle + step * numbers(detected["places"], 2) == pytest.approx(np.array([[1.0, 2.0], [3.0, 4.0]]), abs=step)
