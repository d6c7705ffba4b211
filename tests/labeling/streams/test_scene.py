"""Streams of a scene: each stretch is the track that the network takes for the TV, and its row says which."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.scene.tracks import SceneTracks
from isac_cosim.isacsim.sensing.passages import TrackUse
from isac_cosim.isacsim.sensing.sensors import scene as scene_sensor
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.streams import generate
from isac_cosim.labeling.streams.cost_estimate import estimate
from isac_cosim.labeling.streams.dataset import Streams, summary
from isac_cosim.labeling.streams.generate import generate_streams, streams_of
from isac_cosim.labeling.streams.settings import StreamDatasetSettings
from isac_cosim.labeling.streams.store import (
    COLUMNS,
    TRACK_COLUMNS,
    StoredStretch,
    StreamFacts,
    read_stretches,
    write_stretches,
)
from tests.support.scene_tracks import altered, tracks_of
from tests.support.scripted import InlineEngine, ScriptedSource

HZ = 5.0
STUDY = DatasetStudy.model_validate(
    {
        "scenarios": ["road"],
        "seeds": {"first": 1, "last": 1},
        "sensing": {"scene": {"bodies": "points", "fixes_hz": HZ}},
    }
)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    return ScriptedSource(tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def tracks(source: ScriptedSource) -> SceneTracks:
    """A network that knows everybody after a second, to 5 cm."""
    return tracks_of(source.record(source.load("road"), 1), HZ)


@pytest.fixture
def knowing(tracks: SceneTracks, source: ScriptedSource, monkeypatch: pytest.MonkeyPatch) -> SceneTracks:
    """The same, in place of what would be sensed."""
    monkeypatch.setattr(scene_sensor, "follow", lambda *_: tracks)
    monkeypatch.setattr(generate, "motion_source", lambda study: source)
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    return tracks


def made_of(
    tracks: SceneTracks, source: ScriptedSource, monkeypatch: pytest.MonkeyPatch
) -> tuple[StreamFacts, list[StoredStretch]]:
    """Streams of a network that knows these tracks."""
    monkeypatch.setattr(scene_sensor, "follow", lambda *_: tracks)
    scenario = source.load("road")
    return streams_of(STUDY, StreamDatasetSettings(), scenario, source.record(scenario, 1))


def of_vehicle(stretches: list[StoredStretch], vehicle: str) -> list[StoredStretch]:
    return [stretch for stretch in stretches if stretch.tv_id == vehicle]


def test_a_stretch_is_the_track_that_is_taken_for_its_vehicle(
    knowing: SceneTracks, tmp_path: Path, source: ScriptedSource
) -> None:
    streams = generate_streams(STUDY, tmp_path / "out", InlineEngine(), source=source)
    streams.verify()
    assert streams.meta.study["sensing"]["scene"]["fixes_hz"] == HZ
    facts, stretches = next(iter(streams.read()))
    assert {stretch.tv_id for stretch in stretches} == {"follow0", "follow1"}
    for stretch in stretches:
        times = stretch.start_s + np.arange(stretch.tv.shape[1]) / 400
        followed = knowing.followed(stretch.tv_id, times)
        assert followed is not None
        state = followed.state.copy()
        state[:2] -= np.array(stretch.point)[:, None]
        np.testing.assert_allclose(stretch.tv, state, atol=1e-3)
        assert stretch.track is not None
        assert stretch.track.track_id == str(followed.track)
        assert (stretch.track.right_share, stretch.track.breaks) == (1.0, 0)
        assert stretch.track.position_sd_m == pytest.approx(followed.position_sd_m)
    assert facts.scene == knowing.scores
    assert sum(facts.uncovered.values()) + facts.decisions == facts.instants


@pytest.mark.slow
def test_a_road_is_sensed_as_a_scene(source: ScriptedSource) -> None:
    """From echoes on: the network finds both TVs, and follows them throughout."""
    scenario = source.load("road")
    facts, stretches = streams_of(STUDY, StreamDatasetSettings(), scenario, source.record(scenario, 1))
    assert facts.scene is not None
    assert facts.scene.idf1 is not None
    assert facts.scene.idf1 > 0.95
    assert {stretch.tv_id for stretch in stretches} == {"follow0", "follow1"}
    for stretch in stretches:
        assert np.hypot(*(stretch.tv - stretch.tv_truth)[:2]).max() < 0.5
        assert stretch.track is not None
        assert (stretch.track.right_share, stretch.track.breaks) == (1.0, 0)
        assert 1e-4 < stretch.track.position_sd_m < 0.5


def test_a_lost_track_is_a_gap_until_the_next_one(
    tracks: SceneTracks, source: ScriptedSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is lost for half a second goes on, with what it was like before; what is lost for longer ends."""
    (whole,) = of_vehicle(made_of(tracks, source, monkeypatch)[1], "follow0")
    short = altered(tracks, 8.0, 8.5, {"follow0": None}, {"follow0": 77})
    (bridged,) = of_vehicle(made_of(short, source, monkeypatch)[1], "follow0")
    assert bridged.track is not None
    assert (bridged.track.breaks, len(bridged.decision_s)) == (1, len(whole.decision_s))
    assert 0.9 < bridged.track.right_share < 1.0
    facts, stretches = made_of(altered(tracks, 8.0, 12.0, {"follow0": None}, {"follow0": 77}), source, monkeypatch)
    before, after = of_vehicle(stretches, "follow0")
    assert before.track is not None
    assert after.track is not None
    assert before.decision_s[-1] == pytest.approx(7.8 + 1.0 + 0.1, abs=0.21)
    assert (after.start_s, after.track.track_id, after.track.right_share) == (pytest.approx(12.0, abs=0.01), "77", 1.0)
    missing = len(whole.decision_s) - len(before.decision_s) - len(after.decision_s)
    assert missing > 30
    assert sum(facts.uncovered.values()) + facts.decisions == facts.instants


def test_a_swapped_track_goes_on_with_the_other_vehicle(
    tracks: SceneTracks, source: ScriptedSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    instant = tracks.instants[round(8.0 * HZ)]
    number = {str(of): int(own) for of, own in zip(instant.vehicle, instant.number, strict=True)}
    swapped: dict[str, int | None] = {"follow0": number["lead0"], "lead0": number["follow0"]}
    stretches = made_of(altered(tracks, 8.0, 99.0, swapped, {}), source, monkeypatch)[1]
    (stretch,) = of_vehicle(stretches, "follow0")
    assert stretch.track is not None
    assert stretch.track.track_id == str(number["follow0"])
    assert stretch.track.breaks == 0
    assert 0.1 < stretch.track.right_share < 0.9
    apart = np.hypot(*(stretch.tv - stretch.tv_truth)[:2])
    assert apart[: round((7.9 - stretch.start_s) * 400)].max() < 0.5
    assert apart[round((8.1 - stretch.start_s) * 400) :].min() > 20.0


def test_the_command_makes_them_and_inspect_shows_the_scores(
    knowing: SceneTracks, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    assert cosim.main(["generate", "road", "-o", out, "--streams", "--scene", "--seeds", "1:1", "--json"]) == 0
    captured = capfd.readouterr()
    content = json.loads(captured.out.splitlines()[-1])
    assert content["scene"] == knowing.scores.model_dump(mode="json")
    assert "scene: rms_m 0.05, p95_m None" in captured.err
    study = Streams.open(out).meta.study
    assert study["sensing"]["scene"]["numerology"] == "nr100"
    assert study["sensing"]["channel"]["kind"] == "link"
    assert cosim.main(["generate", "road", "-o", out, "--streams", "--scene", "--snr", "0:10"]) == 2
    assert "a scene has the link budget" in capfd.readouterr().err


@pytest.mark.slow
def test_worker_processes_give_the_same_bytes(source: ScriptedSource, tmp_path: Path) -> None:
    study = STUDY.model_copy(update={"seeds": STUDY.seeds.model_copy(update={"last": 2})})
    one, other = (
        generate_streams(study, tmp_path / name, engine, source=source)
        for name, engine in (("one", InlineEngine()), ("other", LocalEngine(2)))
    )
    assert one.meta.files == other.meta.files


def test_streams_of_single_targets_say_nothing_of_tracks(source: ScriptedSource, tmp_path: Path) -> None:
    one_by_one = STUDY.model_copy(update={"sensing": scene_sensor.as_sensed(STUDY.sensing, scene=False)})
    streams = generate_streams(one_by_one, tmp_path / "out", InlineEngine(), source=source)
    path = streams.path / "stretches" / "road-1.parquet"
    assert pq.read_schema(path).names == COLUMNS.names
    assert "scene" not in json.loads(pq.read_schema(path).metadata[b"isac_cosim.streams"])
    assert "scene" not in summary(streams)
    assert next(iter(streams.read()))[1][0].track is None


def test_tracks_that_cannot_be_are_refused(
    tracks: SceneTracks, source: ScriptedSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts, (stretch, *_) = made_of(tracks, source, monkeypatch)
    for name in ("stretches", "events"):
        (tmp_path / name).mkdir()
    path = tmp_path / "stretches" / "road-1.parquet"
    write_stretches(tmp_path, facts, [stretch])
    (again,) = read_stretches(path)[1]
    assert again.track is not None
    assert stretch.track is not None
    assert (again.track.track_id, again.track.breaks) == (stretch.track.track_id, 0)
    right = TrackUse("7", 0.5, 1, 0.1)
    for fault, use in (
        ("right_share", replace(right, right_share=1.5)),
        ("breaks", replace(right, breaks=-1)),
        ("position_sd_m", replace(right, position_sd_m=float("nan"))),
    ):
        write_stretches(tmp_path, facts, [replace(stretch, track=use)])
        with pytest.raises(InputError, match=f"{fault}: is not finite, or out of bounds"):
            read_stretches(path)
    write_stretches(tmp_path, facts, [stretch])
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["breaks"]), path, write_page_checksum=True)
    with pytest.raises(InputError, match="breaks: the column is missing"):
        read_stretches(path)
    numbered = table.set_column(table.schema.get_field_index("track_id"), "track_id", pa.array([7]))
    pq.write_table(numbered, path, write_page_checksum=True)
    with pytest.raises(InputError, match="track_id: the column is of int64, not of string"):
        read_stretches(path)
    assert TRACK_COLUMNS.names == list(vars(right))


def test_what_a_scene_costs_is_said() -> None:
    """On the motorway: 140 s of processor time for 120 s of points, whatever the vehicle-hours (docs/scene.md)."""
    alone, points, often = (
        estimate(STUDY.model_copy(update={"sensing": STUDY.sensing.model_validate(content)}))
        for content in ({}, {"scene": {"bodies": "points"}}, {"scene": {"fixes_hz": 50.0}})
    )
    assert alone is not None
    assert points is not None
    assert often is not None
    assert points.cpu_s > alone.cpu_s + 200
    assert often.cpu_s > 2.5 * points.cpu_s
    assert points.bytes == alone.bytes
