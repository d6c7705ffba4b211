"""Datasets of scenes: made and sensed anew with equal bytes, and refused where the episode is not the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.command_line.arguments import SenseArguments, dataset_study, resense_settings
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.summary import summary
from isac_cosim.labeling.generation import recorded_again
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, resense
from isac_cosim.labeling.generation.watching import watch_episode
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

SCENE = {"scene": {"bodies": "points", "fixes_hz": 5.0}, "channel": {"kind": "link"}}
ANEW = ResenseSettings.model_validate({"sensor": "scene", "sensing": SCENE})
Recorded = Callable[[MotionSource], None]


@dataclass(frozen=True)
class Moved(ScriptedSource):
    """The same vehicles, a micrometre farther on."""

    def record(self, scenario: Scenario, seed: int) -> Recording:
        recording = super().record(scenario, seed)
        tracks = {name: replace(track, x=track.x + 1e-5) for name, track in recording.tracks.items()}
        return replace(recording, tracks=tracks)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    return ScriptedSource(tmp_path_factory.mktemp("road"))


@pytest.fixture(scope="module")
def plain(source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """One vehicle at a time."""
    study = small_study(seeds={"first": 1, "last": 1})
    return generate(study, tmp_path_factory.mktemp("plain") / "data", InlineEngine(), source=source)


@pytest.fixture(scope="module")
def scene(source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    study = small_study(seeds={"first": 1, "last": 1}, sensing=SCENE)
    return generate(study, tmp_path_factory.mktemp("scene") / "data", InlineEngine(), source=source)


@pytest.fixture
def recorded_by(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """Let a source record the episodes again that the datasets come from."""

    def record(source: MotionSource) -> None:
        monkeypatch.setattr(recorded_again, "motion_source", lambda study: source)
        recorded_again._load.cache_clear()

    return record


def test_a_dataset_of_a_scene_says_which_tracks_it_holds(scene: Dataset) -> None:
    scene.verify()
    frame = scene.frame()
    assert set(frame["sensor"]) == {"scene"}
    assert (frame["track_id"].str.isdigit() & (frame["breaks"] == 0)).all()
    assert (frame["right_share"] == 1.0).all()
    assert frame["position_sd_m"].between(1e-4, 0.5).all()
    assert frame["snr_db"].between(-20, 60).all()
    assert (frame["n_sites"] >= 2).all()
    states = scene.arrays("tv", "tv_truth")
    assert np.hypot(*(states["tv"] - states["tv_truth"])[:, :2].transpose(1, 0, 2)).max() < 0.5


def test_inspect_shows_the_scores(scene: Dataset, plain: Dataset) -> None:
    scores = summary(scene)["scene"]
    assert {"rms_m", "p95_m", "missed", "missed_slow", "false", "switches_per_km", "idf1", "nees"} <= set(scores)
    assert scores["idf1"] > 0.95
    assert scores["rms_m"] < 0.1
    assert "scene" not in summary(plain)
    assert scene.episode(scene.meta.shards[0]).scene is not None
    assert plain.episode(plain.meta.shards[0]).scene is None
    assert (plain.frame()["track_id"] == "").all()


@pytest.mark.slow
def test_sensed_anew_a_dataset_is_as_if_it_had_been_generated_so(
    source: ScriptedSource, scene: Dataset, plain: Dataset, recorded_by: Recorded, tmp_path: Path
) -> None:
    recorded_by(source)
    sensed = resense(plain, ANEW, tmp_path / "anew", InlineEngine())
    sensed.verify()
    for dataset in (sensed, scene):
        assert dataset.frame()["sample_id"].tolist() == ["road-1-0", "road-1-1"]
    for name in ("tv", "tv_truth", "uv"):
        assert np.array_equal(sensed.arrays(name)[name], scene.arrays(name)[name])
    columns = ["track_id", "right_share", "breaks", "position_sd_m", "snr_db", "n_sites", "sensor"]
    assert sensed.frame(columns).equals(scene.frame(columns))
    assert summary(sensed)["scene"] == summary(scene)["scene"]


@pytest.mark.slow
def test_what_a_dataset_says_of_its_sensing_is_how_it_was_sensed(
    source: ScriptedSource, plain: Dataset, scene: Dataset, recorded_by: Recorded, tmp_path: Path
) -> None:
    """Evaluations in traffic sense as the dataset says: settings without a scene get one, and the other way round."""
    recorded_by(source)
    settings = ResenseSettings.model_validate({"sensor": "scene", "sensing": {"view": {"range_m": 120.0}}})
    sensed = resense(plain, settings, tmp_path / "scene", InlineEngine())
    assert sensed.meta.study["sensing"]["scene"]["numerology"] == "nr100"
    assert sensed.meta.study["sensing"]["channel"]["kind"] == "link"
    own = ResenseSettings.model_validate({"sensing": scene.meta.study["sensing"]})
    alone = resense(scene, own, tmp_path / "alone", InlineEngine())
    assert "scene" not in alone.meta.study["sensing"]
    assert set(alone.frame()["sensor"]) == {"isac"}
    assert "scene" not in summary(alone)


def test_an_episode_that_is_not_the_same_is_refused(
    source: ScriptedSource, plain: Dataset, recorded_by: Recorded, tmp_path: Path
) -> None:
    recorded_by(Moved(source.folder))
    with pytest.raises(InputError, match=r"road, seed 1, is not the same .* generate the dataset anew with --scene"):
        resense(plain, ANEW, tmp_path / "moved", InlineEngine())


def test_files_that_have_changed_are_refused(
    source: ScriptedSource, plain: Dataset, recorded_by: Recorded, tmp_path: Path
) -> None:
    @dataclass(frozen=True)
    class Rebuilt(ScriptedSource):
        def digest(self, scenario: Scenario) -> str:
            return "0" * 64

    recorded_by(Rebuilt(source.folder))
    with pytest.raises(InputError, match=r"the files of road have changed since they were recorded; restore them"):
        resense(plain, ANEW, tmp_path / "rebuilt", InlineEngine())


def test_repeats_of_a_scene_are_refused(plain: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a scene is sensed once"):
        resense(plain, ANEW.model_copy(update={"records": 5}), tmp_path / "more", InlineEngine())


def test_arguments_of_a_scene(plain: Dataset, scene: Dataset) -> None:
    study = dataset_study(["motorway"], None, None, None, scene=True)
    assert study.sensing.scene is not None
    assert study.sensing.channel.kind == "link"
    assert dataset_study(["motorway"], None, None, "link", scene=True) == study
    with pytest.raises(InputError, match="--snr 0:10: a scene has the link budget"):
        dataset_study(["motorway"], None, None, "0:10", scene=True)
    for arguments in (SenseArguments(None, scene=True), SenseArguments("scene")):
        settings = resense_settings(plain, arguments)
        assert (settings.sensor, settings.sensing.channel.kind) == ("scene", "link")
        assert settings.sensing.scene is not None
    assert resense_settings(scene, SenseArguments("scene")).sensing == scene_sensing(scene)
    one_by_one = resense_settings(scene, SenseArguments(None))
    assert (one_by_one.sensor, one_by_one.sensing.scene) == ("isac", None)
    for sensor, given, fault in (
        ("radar", {}, "--scene is a sensor of its own"),
        (None, {"snr": "0:10"}, "--snr applies to vehicles that are sensed one by one"),
        (None, {"estimator": "grid"}, "--estimator applies to vehicles"),
    ):
        with pytest.raises(InputError, match=fault):
            resense_settings(plain, SenseArguments(sensor, scene=True, **given))  # type: ignore[arg-type]


def scene_sensing(dataset: Dataset) -> object:
    return small_study(sensing=dataset.meta.study["sensing"]).sensing


def test_what_senses_a_study_of_a_scene_is_the_scene(source: ScriptedSource) -> None:
    """Evaluations in traffic and closed loops ask for the sites, too."""
    road = source.load("road")
    assert watch_episode(small_study(sensing=SCENE), road, 1).name == "scene"
    assert watch_episode(small_study(), road, 1).name == "isac"
    assert watch_episode(small_study(sensing=SCENE), road, 1, sensor="truth").name == "truth"


def test_a_dataset_that_an_earlier_schema_began_is_not_continued(source: ScriptedSource, tmp_path: Path) -> None:
    from isac_cosim.labeling.dataset.meta import read_description, write_meta

    study = small_study(seeds={"first": 1, "last": 1})
    generate(study, tmp_path / "data", InlineEngine(), source=source)
    before = read_description(tmp_path / "data")
    assert before is not None
    write_meta(tmp_path / "data", before.model_copy(update={"schema_version": 4, "complete": False}))
    with pytest.raises(InputError, match="holds a dataset of schema version 4, and this version writes 5"):
        generate(study, tmp_path / "data", InlineEngine(), source=source)
