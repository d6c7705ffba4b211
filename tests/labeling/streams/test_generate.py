"""Streams as data: what is stored, that it is what live evaluation sees, and that it goes on where it stopped."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import cosim
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.traffic.motion import states
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams import generate
from isac_cosim.labeling.streams.cost_estimate import estimate
from isac_cosim.labeling.streams.dataset import Streams, summary
from isac_cosim.labeling.streams.generate import generate_streams, timing_of
from isac_cosim.labeling.streams.reports import Reports
from isac_cosim.labeling.streams.sensed import StretchSensing
from isac_cosim.labeling.streams.settings import StreamDatasetSettings
from isac_cosim.labeling.streams.store import StoredStretch, StreamFacts, read_stretches, write_stretches
from isac_cosim.labeling.streams.stretches import watched
from tests.support.scripted import InlineEngine, ScriptedSource

STUDY = DatasetStudy.model_validate(
    {"scenarios": ["road"], "seeds": {"first": 1, "last": 2}, "sensing": {"channel": {"kind": "link"}}}
)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    return ScriptedSource(tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def streams(source: ScriptedSource, tmp_path_factory: pytest.TempPathFactory) -> Streams:
    return generate_streams(STUDY, tmp_path_factory.mktemp("streams") / "out", InlineEngine(), source=source)


def test_windows_cut_on_reading_are_those_of_the_sensed_stretches(streams: Streams, source: ScriptedSource) -> None:
    """An independent walk through sensing: the same states and reports, but for the rounding to float32."""
    scenario = source.load("road")
    recording = source.record(scenario, 1)
    timing = timing_of(STUDY, StreamDatasetSettings())
    sensing = StretchSensing(STUDY, recording, watch_episode(STUDY, scenario, 1, recording), timing.before_decision_s)
    reports = Reports(sensing)
    tracks = list(sensing.tracks(watched(recording, Surroundings(recording), STUDY.pairs, timing).stretches))
    facts, stored = next(iter(streams.read()))
    assert len(stored) == len(tracks) > 0
    compared = 0
    for stretch, track in zip(stored, tracks, strict=True):
        assert stretch.tv_id == track.stretch.tv
        np.testing.assert_array_equal(stretch.decision_s, track.stretch.decision_s)
        for k in range(0, len(stretch.decision_s), 37):
            time_s = float(stretch.decision_s[k])
            tv, uv = stretch.window(k, (880, 220), (400.0, 100.0), 0.02)
            last = round((time_s - track.stretch.start_s) * 400)
            np.testing.assert_allclose(tv, track.state[:, last - 879 : last + 1], atol=2e-4)
            expected = reports.window(track.stretch.uv[k], time_s - 0.02, 220)
            np.testing.assert_allclose(uv, expected, atol=2e-4)
            true, _ = stretch.window(k, (880, 220), (400.0, 100.0), 0.02, true=True)
            instants = time_s - np.arange(879, -1, -1) / 400
            driven = states(recording, recording.tracks[stretch.tv_id], instants, STUDY.motion)
            np.testing.assert_allclose(true, driven, atol=2e-3)
            compared += 1
    assert compared > 5
    assert facts.decisions == sum(len(stretch.decision_s) for stretch in stored)
    with pytest.raises(ValueError, match="begins before what is stored"):
        stored[0].window(0, (4000, 220), (400.0, 100.0), 0.02)


def test_the_table_of_events_is_that_of_the_labels(streams: Streams, source: ScriptedSource) -> None:
    recording = source.record(source.load("road"), 1)
    table = pq.read_table(streams.path / "events" / "road-1.parquet").to_pylist()
    labelled = {(event.vehicle, event.intention.text, event.onset) for event in label(recording, STUDY.labels).events
                if event.intention.text != "following"}  # fmt: skip
    assert {(row["vehicle"], row["intention"], row["onset"]) for row in table if row["left_out"] != "near_miss"} == (
        labelled
    )


def test_any_engine_and_a_resumed_folder_give_the_same_bytes(
    streams: Streams, source: ScriptedSource, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match="1 of 2 episodes failed, road, seed 2"):
        generate_streams(STUDY, tmp_path / "out", InlineEngine(), source=replace(source, broken=(2,)))
    with pytest.raises(InputError, match="is not finished"):
        Streams.open(tmp_path / "out")
    kept = (tmp_path / "out" / "stretches" / "road-1.parquet").stat().st_mtime_ns
    again = generate_streams(STUDY, tmp_path / "out", InlineEngine(), source=source)
    assert (tmp_path / "out" / "stretches" / "road-1.parquet").stat().st_mtime_ns == kept
    assert again.meta.files == streams.meta.files
    fewer = STUDY.model_copy(update={"seeds": STUDY.seeds.model_copy(update={"last": 1})})
    with pytest.raises(InputError, match="holds streams of another study"):
        generate_streams(fewer, tmp_path / "out", InlineEngine(), source=source)


@pytest.mark.slow
def test_worker_processes_give_the_same_bytes(streams: Streams, source: ScriptedSource, tmp_path: Path) -> None:
    assert generate_streams(STUDY, tmp_path / "out", LocalEngine(2), source=source).meta.files == streams.meta.files


def test_a_summary_counts_hours_and_events(streams: Streams) -> None:
    content = summary(streams)
    assert content["coverage"] + sum(content["uncovered"].values()) == pytest.approx(1.0)
    assert content["vehicle_hours"] == pytest.approx(content["coverage"] * content["driving_hours"], rel=1e-3)
    brakes = content["by_intention"]["hard_brake"]
    assert brakes["counted"] == 2
    assert brakes["per_vehicle_hour"] == pytest.approx(2 / content["vehicle_hours"], rel=0.01)


@pytest.mark.parametrize("name", ["stretches/road-1.parquet", "events/road-2.parquet", "roads/road.parquet"])
def test_a_changed_file_is_noticed(streams: Streams, source: ScriptedSource, tmp_path: Path, name: str) -> None:
    made = generate_streams(STUDY, tmp_path / "out", InlineEngine(), source=source)
    made.verify()
    path = made.path / name
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(InputError, match=f"{path.name}: differs from its digest"):
        made.verify()


def written(stretch: StoredStretch, folder: Path) -> Path:
    """Write an episode of one stretch, as a damaged or made-up file may hold it."""
    for name in ("stretches", "events"):
        (folder / name).mkdir()
    facts = StreamFacts(
        fingerprint="", scenario="road", seed=1, decision_s=0.1, simulated_s=1.0, instants=1, decisions=1, uncovered={},
        events=(),
    )  # fmt: skip
    write_stretches(folder, facts, [stretch])
    return folder / "stretches" / "road-1.parquet"


WRONG: dict[str, Callable[[StoredStretch], StoredStretch]] = {
    "tv: is not finite": lambda s: replace(s, tv=np.full_like(s.tv, np.nan)),
    "tv, tv_truth: are of different lengths": lambda s: replace(s, tv=s.tv[:, 1:]),
    "segment: is not a segment": lambda s: replace(s, segment=s.segment + len(s.uv)),
    "uv_id, uv_first, uv: are of different": lambda s: replace(s, uv_first=(*s.uv_first, 0)),
    "decision_s: is not in order": lambda s: replace(s, decision_s=s.decision_s[::-1]),
    "uv: is not finite": lambda s: replace(s, uv=tuple(np.full_like(part, np.inf) for part in s.uv)),
}


@pytest.mark.parametrize("fault", WRONG)
def test_content_that_no_stream_has_is_refused(streams: Streams, tmp_path: Path, fault: str) -> None:
    _, (stretch, *_) = next(iter(streams.read()))
    with pytest.raises(InputError, match=rf"road-1\.parquet: .*{fault}"):
        read_stretches(written(WRONG[fault](stretch), tmp_path))


def test_what_is_written_is_read(streams: Streams, tmp_path: Path) -> None:
    _, (stretch, *_) = next(iter(streams.read()))
    _, (again,) = read_stretches(written(stretch, tmp_path))
    for name, value in vars(stretch).items():
        if name == "uv":
            for one, other in zip(value, again.uv, strict=True):
                np.testing.assert_array_equal(one, other)
        else:
            np.testing.assert_array_equal(getattr(again, name), value)


def test_the_command_generates_and_inspects(
    monkeypatch: pytest.MonkeyPatch, source: ScriptedSource, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(generate, "motion_source", lambda study: source)
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    out = str(tmp_path / "out")
    assert cosim.main(["generate", "road", "-o", out, "--streams", "--seeds", "1:1", "--json"]) == 0
    captured = capfd.readouterr()
    made = json.loads(captured.out.splitlines()[-1])
    assert "vehicle-hours if the traffic is that of the bundled motorway" in captured.err
    assert made["seeds"] == ["road-1"]
    assert cosim.main(["inspect", out, "--verify", "--json"]) == 0
    assert json.loads(capfd.readouterr().out.splitlines()[-1]) == {**made, "verified": True}
    assert cosim.main(["generate", "road", "-o", out, "--streams", "--samples", "5"]) == 2
    assert "give --seeds in its place" in capfd.readouterr().err
    assert cosim.main(["train", out, "-o", str(tmp_path / "run")]) == 2


def test_recordings_of_their_own_length_have_no_estimate() -> None:
    assert estimate(DatasetStudy(source="kinematic")) is None
    cost = estimate(STUDY)
    assert cost is not None
    assert cost.episodes == 2
    assert cost.bytes > 0
